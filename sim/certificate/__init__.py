"""Certificate and verification of a dataset."""
