"""Buildings, ground and routes of scenes."""
