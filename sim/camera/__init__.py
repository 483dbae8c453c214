"""The stereo camera: OpenGL, exposure, lens and image sensor."""
