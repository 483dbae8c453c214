"""Images, films and datasets of trials."""
