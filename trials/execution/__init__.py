"""Recordings and runs: made on all cores, kept in one cache."""
