"""Planning where to drive, and driving there."""
