"""Keyframes, local bundle adjustment, relocalization and smoothing."""
