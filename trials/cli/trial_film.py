"""`driftyard trial-film`: one trial with each source of localization, as an animation."""

from collections.abc import Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image as Pillow

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, argument, option
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.studies.trial_runner import rover_nav
from vo.contract.arrays import Image
from vo.contract.files import known_suffix, replacing

ICE = {"terrain.ice_share": 0.6, "terrain.ice_friction": 0.08}
"""Wet patches on which wheels spin, and which do not disturb the cameras."""
EVERY, PERIOD_MS, WIDTH_PX, QUALITY = 5, 100, 720, 50
"""Steps from frame to frame, duration, width and compression quality of a frame."""


def trial_film(
    out: Path = argument(..., "Animation to write, .webp."),
    scene: str = option("office", "Registered scene, MJCF file or module:function."),
    layout: int = option(0, "Random seed of the world.", min=0),
    seed: int = option(0, "Random seed of start, goal and noise.", min=0),
    sources: str = option("wheels,vo", "Sources of localization, as for `drive`.", metavar="A,B,C"),
    camera: Camera = DEFAULT_CAMERA,
    seconds: float = option(45.0, "Time limit of the trial, s.", min=1),
) -> None:
    """Film a trial on slippery ground with each source of localization, one above the other."""
    known_suffix(out, (".webp",))
    options = {"scene": scene, "rate_hz": 10.0, "settings": ICE, "observe": NavigatorPolicy.NEEDS}
    options |= {
        "layout": layout,
        "camera": camera,
        "time_limit_s": seconds,
        "render_mode": "rgb_array",
    }
    films = [
        list(_frames({**options, "localization": source.strip()}, seed))
        for source in sources.split(",")
    ]
    longest = max(map(len, films))
    ended = [film + film[-1:] * (longest - len(film)) for film in films]  # stays as it is
    first, *rest = (Pillow.fromarray(np.vstack(rows)) for rows in zip(*ended, strict=True))
    with replacing(out) as partial:
        first.save(
            partial, "WEBP", save_all=True, append_images=rest, duration=PERIOD_MS, loop=0,
            quality=QUALITY,
        )  # fmt: skip
    console.out.print(f"{out}")


def _frames(options: Mapping[str, Any], seed: int) -> Iterator[Image]:
    with rover_nav(options) as env:
        observation, info = env.reset(seed=seed)
        policy = NavigatorPolicy(env)
        for steps in count():
            if steps % EVERY == 0 or info["outcome"]:
                whole = np.asarray(env.render(), np.uint8)
                size = WIDTH_PX, 2 * round(WIDTH_PX * whole.shape[0] / whole.shape[1] / 2)
                yield np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8)
            if info["outcome"]:
                return
            observation, _, _, _, info = env.step(policy.act(observation))
