"""Image formation: lens, image sensor, automatic exposure and resampling."""
