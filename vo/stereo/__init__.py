"""Disparity: dense, or sparse at features."""
