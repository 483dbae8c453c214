"""The same trial with several sources of localization, one above the other, as one animation."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image as Pillow

from trials.gym.env.environments import RoverNav
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.studies.trial_runner import rover_nav
from vo.contract.arrays import Image
from vo.contract.files import replacing

ICE = {"terrain.ice_share": 0.6, "terrain.ice_friction": 0.08}
"""Wet patches on which wheels spin, and which do not disturb the cameras."""
EVERY, PERIOD_MS, WIDTH_PX, QUALITY = 5, 100, 720, 50
"""Steps from frame to frame, duration, width and compression quality of a frame."""


def film_sources(
    out: Path, scene: str, layout: int, seed: int, sources: Sequence[str], seconds: float
) -> None:
    """Film a trial on slippery ground with each source of localization.

    Args:
        out: Animation to write, .webp.
        scene: Registered scene, MJCF file or module:function.
        layout: Random seed of the world.
        seed: Random seed of start, goal and noise.
        sources: Sources of localization.
        seconds: Time limit of the trial.
    """
    options = {"scene": scene, "rate_hz": 10.0, "settings": ICE, "observe": NavigatorPolicy.NEEDS}
    options |= {"layout": layout, "time_limit_s": seconds, "render_mode": "rgb_array"}
    films = [list(_frames({**options, "localization": x}, seed)) for x in sources]
    last = [film[-1] for film in films]
    frames = [
        # A trial that has ended stays as it is.
        np.vstack([now if now is not None else end for now, end in zip(row, last, strict=True)])
        for row in zip_longest(*films)
    ]
    first, *rest = (Pillow.fromarray(x) for x in frames)
    with replacing(out) as partial:
        first.save(
            partial, "WEBP", save_all=True, append_images=rest, duration=PERIOD_MS, loop=0,
            quality=QUALITY,
        )  # fmt: skip


def _frames(options: Mapping[str, Any], seed: int) -> Iterator[Image]:
    with rover_nav(options) as env:
        observation, info = env.reset(seed=seed)
        policy, steps = NavigatorPolicy(env), 0
        yield _resized(env)
        while not info["outcome"]:
            observation, _, _, _, info = env.step(policy.act(observation))
            steps += 1
            if steps % EVERY == 0 or info["outcome"]:
                yield _resized(env)


def _resized(env: RoverNav) -> Image:
    whole = np.asarray(env.render(), np.uint8)
    size = WIDTH_PX, 2 * round(WIDTH_PX * whole.shape[0] / whole.shape[1] / 2)
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8)
