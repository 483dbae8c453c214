"""Inertial sensor, wheel encoders, and the tables of a dataset."""
