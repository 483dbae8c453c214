"""Studies over many recordings."""
