"""A film of a trial: the rendered view after every step, as MP4 or GIF, without moviepy."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from sim.preview.film import FILMS, writing
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix


class Filmed(gymnasium.Wrapper[Any, Array, Any, Array]):
    """Writes one film for each trial, complete when the trial ends or the environment is closed."""

    def __init__(self, env: gymnasium.Env[Any, Array], out: Path) -> None:
        """Film an environment with render_mode rgb_array.

        Args:
            env: The environment.
            out: Name of the first film; later ones have `_1`, `_2`, ... before the suffix.

        Raises:
            SettingsError: If the suffix is not .mp4 or .gif, or the environment has another
                render_mode.
        """
        super().__init__(env)
        if env.render_mode != "rgb_array":
            raise SettingsError('a film needs render_mode="rgb_array"')
        known_suffix(out, FILMS)
        self._out, self._trials = out, 0
        self._film = ExitStack()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin a trial and its film."""
        self._film.close()
        result = self.env.reset(seed=seed, options=options)
        number = f"_{self._trials}" if self._trials else ""
        out = self._out.with_name(f"{self._out.stem}{number}{self._out.suffix}")
        out.parent.mkdir(parents=True, exist_ok=True)
        self._write = self._film.enter_context(writing(out, self.env.metadata["render_fps"]))
        self._trials += 1
        self._write(np.asarray(self.env.render(), np.uint8))
        return result

    def step(self, action: Array) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Drive on; the film is complete when the trial ends."""
        result = self.env.step(action)
        self._write(np.asarray(self.env.render(), np.uint8))
        if result[2] or result[3]:
            self._film.close()
        return result

    def close(self) -> None:
        """Finish the film."""
        self._film.close()
        super().close()
