"""Pose of the camera from matches: minimal solvers, RANSAC and refinement."""
