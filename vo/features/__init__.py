"""Features of an image: detection, sub-pixel position, image quality."""
