"""The same trial by several sources of localization, one above the other, as one animation."""

from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any

import cv2
import gymnasium
import numpy as np
import typer
from PIL import Image as Pillow

from sim.preview.image_file import known_suffix
from trials.cli.main import guard
from trials.gym.env.environments import RoverNav
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.studies.fleet import NAV
from vo.contract.arrays import Image
from vo.contract.files import replacing

ICE = {"terrain.ice_share": 0.6, "terrain.ice_friction": 0.08}
"""Wet patches on which wheels spin and cameras do not mind."""
EVERY, PERIOD_MS, WIDTH_PX, QUALITY = 5, 100, 720, 50
"""Steps from picture to picture, and how these are written."""


def showcase(
    out: Annotated[Path, typer.Argument(help="Animation to write, .webp.")],
    scene: Annotated[str, typer.Option(help="Name, MJCF file or module:function.")] = "office",
    layout: Annotated[int, typer.Option(min=0, help="Seed of the world.")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Of start, goal and noise.")] = 0,
    sources: Annotated[str, typer.Option(help="Of localization.")] = "wheels,vo",
    seconds: Annotated[float, typer.Option(min=1, help="After which all give up.")] = 45.0,
) -> None:
    """Film a trial on slippery ground by each source."""
    known_suffix(out, (".webp",))
    options = {"scene": scene, "rate_hz": 10.0, "settings": ICE, "observe": NavigatorPolicy.NEEDS}
    options |= {"layout": layout, "time_limit_s": seconds, "render_mode": "rgb_array"}
    films = [list(_pictures(options, x.strip(), seed)) for x in sources.split(",")]
    last = [film[-1] for film in films]
    frames = [
        # Who is done stays where it is.
        np.vstack([now if now is not None else end for now, end in zip(row, last, strict=True)])
        for row in zip_longest(*films)
    ]
    first, *rest = (Pillow.fromarray(x) for x in frames)
    with replacing(out) as partial:
        first.save(
            partial, "WEBP", save_all=True, append_images=rest, duration=PERIOD_MS, loop=0,
            quality=QUALITY,
        )  # fmt: skip


def _pictures(options: dict[str, Any], source: str, seed: int) -> Iterator[Image]:
    env = gymnasium.make(NAV, disable_env_checker=True, localization=source, **options)
    rover = env.unwrapped
    assert isinstance(rover, RoverNav)
    observation, info = rover.reset(seed=seed)
    policy, steps = NavigatorPolicy(rover), 0
    yield _shrunk(rover)
    while not info["outcome"]:
        observation, _, _, _, info = rover.step(policy.act(observation))
        steps += 1
        if steps % EVERY == 0 or info["outcome"]:
            yield _shrunk(rover)
    env.close()


def _shrunk(rover: RoverNav) -> Image:
    whole = np.asarray(rover.render(), np.uint8)
    size = WIDTH_PX, 2 * round(WIDTH_PX * whole.shape[0] / whole.shape[1] / 2)
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8)


if __name__ == "__main__":
    guard(lambda: typer.run(showcase))
