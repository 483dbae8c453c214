"""Datasets in locations such as buckets: as folders, or as tar files with an index."""
