"""What the world looks like: builders that return a Scene; no physics loop, no GL."""
