"""Pictures, films and datasets of trials."""
