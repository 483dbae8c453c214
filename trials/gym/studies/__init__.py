"""Studies over many trials."""
