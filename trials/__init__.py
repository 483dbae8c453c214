"""Everything that composes or compares: scoring, reports, baselines, the command line."""
