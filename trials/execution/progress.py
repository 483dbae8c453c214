"""Progress of long computations, shown by a function that the caller passes in."""

import itertools
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager

Update = Callable[[int, int], None]
"""Takes the number of finished steps and of all steps."""
ProgressBar = Callable[[str], AbstractContextManager[Update]]
"""Shows a bar with a label; yields its update."""


@contextmanager
def no_progress(_: str) -> Generator[Update]:
    """Show nothing."""
    yield lambda done, total: None


@contextmanager
def counted(bar: ProgressBar, label: str, total: int) -> Generator[Callable[[object], None]]:
    """Show a bar that advances by one with every call; the argument is ignored."""
    done = itertools.count(1)
    with bar(label) as update:
        yield lambda _: update(next(done), total)
