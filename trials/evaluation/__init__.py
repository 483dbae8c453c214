"""Errors of trajectories against the truth."""
