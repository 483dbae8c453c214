"""Diagnosis of drift: attribution to stages, Cramér-Rao bound, and error injection."""
