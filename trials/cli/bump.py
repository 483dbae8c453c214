"""`driftyard bump`: a brick under a wheel in every channel of a recording."""

from pathlib import Path

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, Seed, option
from trials.studies.bump import bump_summary, draw_bumps, record_bumps


def bump(
    seed: Seed = 0,
    scene: str = option("office", "Scene to drive through."),
    camera: Camera = DEFAULT_CAMERA,
    out: Path = option(Path("build/bump.png"), "PNG to write."),
) -> None:
    """Drive over loose bricks; draw wheel load, shock, pitch, blur and features over time."""
    channels = record_bumps(scene, seed, camera, console.progress_bar)
    draw_bumps(channels, scene, out)
    console.out.print(bump_summary(channels))
    console.out.print(f"{out}")
