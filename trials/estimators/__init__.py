"""Estimators by name, as a class, as a program, and other systems."""
