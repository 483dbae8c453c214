"""Procedural textures: uint8 (H, W, 3) sRGB images drawn from a generator, no files."""
