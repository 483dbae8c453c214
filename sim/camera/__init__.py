"""The stereo camera: OpenGL rendering and exposure of a moving world."""
