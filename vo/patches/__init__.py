"""Image patches: templates, sub-pixel alignment and normalised cross-correlation."""
