"""Inertial readings."""
