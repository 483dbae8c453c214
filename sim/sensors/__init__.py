"""Inertial readings and wheel encoder counts."""
