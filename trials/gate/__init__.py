"""Gate: an estimator against a stored baseline over paired sequences, with a decision."""
