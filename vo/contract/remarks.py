"""Remarks: what a user should know about an input that is usable all the same."""

import sys
import warnings
from collections.abc import Callable
from functools import partial
from typing import TextIO

from vo.contract.packages import is_own


class Remark(UserWarning):
    """A warning that commands and their workers print as one line, once for each text."""


def remark(message: str) -> None:
    """Issue a remark: one complete line that names the file and what was done about it.

    Its place is the line of the user's that called driftyard.
    """
    level, frame = 2, sys._getframe(1)
    while is_own(frame.f_globals.get("__name__", "")) and frame.f_back is not None:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, Remark, stacklevel=level)


def print_remarks() -> None:
    """From now on print remarks as lines on stderr; other warnings are shown as before."""
    warnings.simplefilter("default", Remark)  # one line for each text
    if getattr(warnings.showwarning, "func", None) is not _show_warning:
        warnings.showwarning = partial(_show_warning, warnings.showwarning)


def _show_warning(
    show: Callable[..., None],
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    if issubclass(category, Remark):
        print(f"driftyard: remark: {' '.join(str(message).split())}", file=sys.stderr)
    else:
        show(message, category, filename, lineno, file, line)
