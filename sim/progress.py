"""The callback that reports progress."""

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Receives the number of frames done and the total number, after each frame."""
