"""Readers of recordings, ground truth and trajectories as other tools write them."""
