"""Measurements of speed, each meant for a process of its own; heavy imports wait for them."""
