"""Estimators: those of this project, classes and programs of others, installed systems."""
