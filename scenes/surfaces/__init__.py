"""Procedural textures: uint8 (H, W, 3) sRGB images drawn from a generator, no files."""

Shape = tuple[int, int]
"""Height and width in pixels."""
Rgb = tuple[float, float, float]
"""Colour in 0..255."""
