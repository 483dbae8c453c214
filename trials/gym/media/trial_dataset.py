"""A trial as a dataset: rendered again, with labels, as the recorder does it."""

from pathlib import Path

from sim.camera.camera import StereoCamera
from sim.record import record_trip
from sim.world.trip import Trip
from trials.gym.world.scene_instance import SceneInstance
from vo.contract.dataset import DatasetWriter
from vo.contract.errors import DatasetError
from vo.contract.settings import amended


def save_trial(instance: SceneInstance, trip: Trip, noise_seed: int, out: Path) -> None:
    """Write a trial; the images equal those of the trial byte by byte.

    The world is left as it was.

    Args:
        instance: Where it took place.
        trip: What was driven.
        noise_seed: Seed of the camera in that trial.
        out: Folder.

    Raises:
        DatasetError: If `out` is in the way, or fewer than two image pairs were delivered.
    """
    if trip.delivered.sum() < 2:
        raise DatasetError(f"{out}: a dataset needs at least two image pairs")
    simulation, settings = instance.simulation, instance.settings
    imu_hz = len(simulation.regular) * settings.rig.rate_hz
    settings = amended(settings, {"imu.rate_hz": imu_hz})
    world = simulation.world
    camera = StereoCamera(world, settings.model_copy(update={"seed": noise_seed}))
    before = world.data.qpos.copy()
    try:
        with DatasetWriter(out) as writer:
            record_trip(writer, world, trip, settings, camera, instance.camera.renderer)
    finally:
        world.data.qpos[:] = before
        world.move_movers(simulation.time_s)
        world.place_bodies()
