"""Images and films of scenes and recordings."""
