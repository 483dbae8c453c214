"""Baked light, lamps and shadows."""
