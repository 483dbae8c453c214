"""What a frame leaves out to end in time (`budget_ms`).

In this order, and each is said in the reason of the frame: fewer landmarks in frames that are no
keyframes; the work of a keyframe waits for a later frame; other predictions are not tried once
there is a pose. A frame always gets the pose that what is left gives, or is lost as without limit.
Runs with a limit depend on the machine: two are not equal.
"""

from time import perf_counter

MIN_SHARE = 0.25
"""Share of the landmarks that is always looked for."""

MAX_WAIT_FRAMES = 5
"""Frames that the work of a keyframe waits at most: without it, landmarks run out."""

SLOWEST, FASTEST = 0.5, 1.1
"""Limits of the change of the share of landmarks from frame to frame."""


class Budget:
    """Follows how long frames take, and what must be left out of the next one.

    Args:
        limit_ms: Time of a frame; 0: no limit.
    """

    def __init__(self, limit_ms: float = 0.0) -> None:
        self._limit_ms, self._share, self._waited, self._start = limit_ms, 1.0, 0, 0.0
        self._left_out: list[str] = []

    def begin(self) -> None:
        """Begin a frame."""
        self._start = perf_counter()
        self._left_out = list[str]()

    def landmarks(self, count: int) -> int:
        """Number of landmarks of a frame that is no keyframe, of the usual count."""
        allowed = max(int(self._share * count), 1)
        if allowed < count:
            self._left_out.append(f"{allowed} of {count} landmarks")
        return allowed

    def lets_keyframe_wait(self) -> bool:
        """Whether the pending work of a keyframe waits for a later frame."""
        if self._share > MIN_SHARE or self._waited >= MAX_WAIT_FRAMES:
            self._waited = 0
            return False
        self._waited += 1
        self._left_out.append("keyframe waits")
        return True

    def is_spent(self) -> bool:
        """Whether no more predictions are tried."""
        if not self._limit_ms or self._elapsed_ms < self._limit_ms:
            return False
        self._left_out.append("no other predictions")
        return True

    def end(self) -> str:
        """End a frame; what it left out, in words."""
        if not self._limit_ms:
            return ""
        change = min(max(self._limit_ms / self._elapsed_ms, SLOWEST), FASTEST)
        self._share = min(max(self._share * change, MIN_SHARE), 1.0)
        return f"in {self._limit_ms:g} ms: {', '.join(self._left_out)}" if self._left_out else ""

    @property
    def _elapsed_ms(self) -> float:
        return 1e3 * (perf_counter() - self._start)
