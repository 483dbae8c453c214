"""Dense labels of a view."""
