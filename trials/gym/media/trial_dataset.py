"""A trial as a dataset: what was driven is rendered again, with labels, as the recorder would."""

from pathlib import Path

from sim.camera.camera import StereoCamera
from sim.record import record_trip
from sim.world.trip import Trip
from trials.gym.world.scene_instance import Site
from vo.contract.dataset import DatasetWriter
from vo.contract.errors import DatasetError
from vo.contract.settings import amended


def save_drive(site: Site, trip: Trip, noise_seed: int, out: Path) -> None:
    """Write what was driven; the images are those that the trial saw, to the byte.

    The world is left as it was.

    Args:
        site: Where it was driven.
        trip: What was driven.
        noise_seed: Of the eyes in that trial.
        out: Folder.

    Raises:
        DatasetError: If `out` is in the way, or fewer than two pictures were taken.
    """
    if trip.delivered.sum() < 2:
        raise DatasetError(f"{out}: a dataset needs two pictures at least")
    world = site.simulation.world
    settings = amended(
        site.settings, {"imu.rate_hz": len(site.simulation.regular) * site.settings.rig.rate_hz}
    )
    camera = StereoCamera(world, settings.model_copy(update={"seed": noise_seed}))
    before = world.data.qpos.copy()
    try:
        with DatasetWriter(out) as writer:
            record_trip(writer, world, trip, settings, camera, site.eyes.renderer)
    finally:
        world.data.qpos[:] = before
        world.move_movers(site.simulation.time_s)
        world.place_bodies()
