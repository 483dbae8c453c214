"""A film of a trial: the rendered view after every step, as MP4 or GIF, without moviepy."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from sim.preview.film import FILMS, writing
from vo.contract.arrays import Array, Image
from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix


class Filmed(gymnasium.Wrapper[Any, Array, Any, Array]):
    """Writes one film for each trial, complete when the trial ends or the environment is closed."""

    def __init__(self, env: gymnasium.Env[Any, Array], out: Path, every: int = 1) -> None:
        """Film an environment.

        Args:
            env: With render_mode rgb_array.
            out: Name of the first film; later ones have `_1`, `_2`, ... before the suffix.
            every: Steps from one frame to the next.

        Raises:
            SettingsError: If the suffix is not .mp4 or .gif, or the environment has another
                render_mode.
        """
        super().__init__(env)
        if env.render_mode != "rgb_array":
            raise SettingsError('a film needs render_mode="rgb_array"')
        known_suffix(out, FILMS)
        self._out, self._every, self._trials, self._steps = out, every, 0, 0
        self._film = ExitStack()
        self._write: Callable[[Image], None] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin a trial and its film."""
        self._film.close()
        result = self.env.reset(seed=seed, options=options)
        number = f"_{self._trials}" if self._trials else ""
        out = self._out.with_name(f"{self._out.stem}{number}{self._out.suffix}")
        out.parent.mkdir(parents=True, exist_ok=True)
        rate_hz = float(self.env.metadata["render_fps"]) / self._every
        self._write = self._film.enter_context(writing(out, rate_hz))
        self._trials, self._steps = self._trials + 1, 0
        self._add_frame()
        return result

    def step(self, action: Array) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Drive on; the last image of a trial is always in its film."""
        result = self.env.step(action)
        self._steps += 1
        over = result[2] or result[3]
        if over or self._steps % self._every == 0:
            self._add_frame()
        if over:
            self._film.close()
            self._write = None
        return result

    def close(self) -> None:
        """Finish the film."""
        self._film.close()
        super().close()

    def _add_frame(self) -> None:
        image = self.env.render()
        if self._write is not None:
            self._write(np.asarray(image, np.uint8))
