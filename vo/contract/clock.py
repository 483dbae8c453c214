"""Wall time by stage."""

from collections.abc import Generator
from contextlib import contextmanager
from time import perf_counter


class Clock:
    """Sums, `ms`, of the wall times of named blocks, in order: `with clock("stereo"): ...`.

    The time of a block inside another one counts for the inner one alone.
    """

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._inner_ms = 0.0

    @contextmanager
    def __call__(self, stage: str) -> Generator[None]:
        """Time a block."""
        outer_ms, self._inner_ms = self._inner_ms, 0.0
        start = perf_counter()
        try:
            yield
        finally:
            whole_ms = 1e3 * (perf_counter() - start)
            self.ms[stage] = self.ms.get(stage, 0.0) + whole_ms - self._inner_ms
            self._inner_ms = outer_ms + whole_ms
