"""Tracking of frames in the local map."""
