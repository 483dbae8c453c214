"""Time of two images of each scene by both engines, and the images themselves."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter, process_time

import numpy as np
from rich.table import Table

from sim.batch import build
from sim.camera.render import StereoRenderer
from sim.camera_names import IDEAL
from sim.imaging.linear_light import Encoding
from sim.settings import RenderSettings
from sim.world.world import build_world
from trials.execution.recording_settings import recording_settings
from trials.report.tables import text_table
from trials.studies.speed.drive import on_cores
from vo.contract.arrays import Array, Image

ENGINES = {
    "classic, 4 samples": RenderSettings(),
    "filament, 1 sample": RenderSettings(engine="filament", samples=1),
    "filament, 4 samples": RenderSettings(engine="filament"),
}
ROUNDS = 3


@dataclass(frozen=True)
class EngineSpeed:
    """Times of the two images of a scene's start by each of ENGINES, and the left image of each.

    Times are seconds of the clock, and of all threads' processor time, the least of some rounds.
    """

    wall_s: list[float]
    cpu_s: list[float]
    images: list[Image]


def measure_engines(
    scene: str, seed: int, width_px: int = 640, color: bool = False, rounds: int = ROUNDS
) -> EngineSpeed:
    """Render the start of a scene, of width : height 4 : 3, by each engine."""
    size = f"rig.width_px={width_px}", f"rig.height_px={width_px * 3 // 4}"
    settings = recording_settings(scene, seed, size, camera=IDEAL)
    world = build_world(build(scene, settings), settings)
    world.place_bodies()
    encode = Encoding("srgb")
    times: list[Array] = []
    images: list[Image] = []
    for engine in ENGINES.values():
        with StereoRenderer(world, engine, color) as renderer:
            left, _ = renderer.render_images()
            spent: list[tuple[float, float]] = []
            for _ in range(rounds):
                wall_s, cpu_s = perf_counter(), process_time()
                renderer.render_images()
                spent.append((perf_counter() - wall_s, process_time() - cpu_s))
        times.append(np.min(spent, axis=0))
        images.append(left if left.dtype == np.uint8 else encode(left))
    wall_s, cpu_s = np.array(times).T.tolist()
    return EngineSpeed(wall_s, cpu_s, images)


def engine_tables(scenes: Sequence[str], seed: int, cores: list[int]) -> Iterator[Table]:
    """Measure scenes, each in a process of its own, and tabulate them.

    A ratio is over the classic engine, of processor time, which other processes lengthen less.
    """
    rows: list[tuple[str, ...]] = []
    for scene in scenes:
        speed = on_cores(cores, measure_engines, scene, seed)
        pairs = zip(speed.wall_s, speed.cpu_s, strict=True)
        ms = (f"{1e3 * wall:.0f} / {1e3 * cpu:.0f}" for wall, cpu in pairs)
        ratios = (f"{cpu / speed.cpu_s[0]:.1f}" for cpu in speed.cpu_s[1:])
        rows.append((scene, *ms, *ratios))
    names = list(ENGINES)
    heads = *names, *(f"ratio, {name}" for name in names[1:])
    title = f"two images 640 x 480, ms of clock / processor, {len(cores)} cores"
    yield text_table((title, *heads), rows)
