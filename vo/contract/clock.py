"""Wall time by stage."""

from collections.abc import Generator
from contextlib import contextmanager
from time import perf_counter


class Clock:
    """Sums, `ms`, of the wall times of named blocks, in order: `with clock("stereo"): ...`."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Generator[None]:
        """Time a block."""
        start = perf_counter()
        try:
            yield
        finally:
            self.ms[stage] = self.ms.get(stage, 0.0) + 1e3 * (perf_counter() - start)
