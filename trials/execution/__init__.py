"""Recordings and runs: made on all cores and cached."""
