"""Calibration of the pair by its own images."""
