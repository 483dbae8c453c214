"""Remarks: what a user should know about an input that is usable all the same."""

import warnings


class Remark(UserWarning):
    """A warning that the command line prints as one line on stderr, once for each text."""


def remark(message: str) -> None:
    """Issue a remark: one complete line that names the file and what was done about it."""
    warnings.warn(message, Remark, stacklevel=2)
