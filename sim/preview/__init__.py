"""Pictures of scenes and datasets for people."""
