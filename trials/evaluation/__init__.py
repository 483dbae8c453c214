"""Evaluation of trajectories against ground truth."""
