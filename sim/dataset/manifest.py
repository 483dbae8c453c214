"""The manifest: content of dataset.json besides the hashes."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import cv2
import mujoco
import numpy as np

from scenes.scene import Thing
from sim.imaging.lens import miscalibration_rotation
from sim.settings import RecordSettings
from sim.world.drawn import rendering_entry
from sim.world.fingerprint import fingerprint
from sim.world.physics import physics_entry
from sim.world.trip import Trip
from sim.world.world import World
from vo.contract.dataset import installed_version
from vo.contract.rig import StereoRig

CONVENTIONS = {
    "transforms": "T_a_b maps coordinates of frame b to frame a: p_a = T_a_b p_b",
    "world": "metres, z up",
    "body": "the rover: origin midway between the driven wheels, x forward, y left, z up; rigid "
    "with cameras and inertial unit, also where the mast bends or a hand carries them",
    "rig": "rig is the delivered calibration, rig_true the camera as it is; labels hold for the "
    "left eye of rig_true and an ideal right eye beside it",
    "camera": "x right, y down, z forward; T_BS in a sensor.yaml is T_body_camera",
    "pixels": "(u, v), centres on integers, so that a centred principal point is (W-1)/2",
    "disparity": "u_left - u_right > 0, of left pixels",
    "depth": "along the optical axis, not along the ray",
    "time": "integer nanoseconds at mid-exposure",
    "quaternions": "scalar first (w, x, y, z)",
}


def manifest(
    world: World,
    settings: RecordSettings,
    delivered: StereoRig,
    trip: Trip,
    things: Sequence[Thing],
    map_entry: dict[str, Any],
    gl: dict[str, str],
    certificate: dict[str, Any],
) -> dict[str, Any]:
    """Return the JSON-ready content, without a time of creation, so that bytes can repeat.

    `delivered` is the calibration in the sensor.yaml files; `things` are the objects by their
    number in the segmentation, from 1 on; `certificate` comes from `certify`.
    """
    scene, R = world.scene, miscalibration_rotation(settings.calibration)
    return {
        "scene": {
            "name": scene.name,
            "source": scene.source or scene.name,
            "tests": scene.tests,
            "tags": sorted(scene.tags),
        },
        "world": fingerprint(world),
        "physics": physics_entry(world),
        "rendering": rendering_entry(world),
        "seed": settings.seed,
        "settings": settings.model_dump(mode="json"),
        "complete": not trip.ended,
        "ended": trip.ended,
        "frames": int(trip.delivered.sum()),
        "dropped_frames": int((~trip.delivered).sum()),
        "path_length_m": round(trip.length_m, 4),
        "rig": rig_table(delivered),
        "rig_true": {**rig_table(world.rig), "R_nominal_right": R.tolist()},
        "map": map_entry,
        "things": [
            {"id": k, "name": thing.name, "class": thing.kind.name.lower()}
            for k, thing in enumerate(things, start=1)
        ],
        "conventions": CONVENTIONS,
        "software": {
            "driftyard": installed_version("driftyard"),
            "mujoco": mujoco.__version__,
            "numpy": np.__version__,
            "opencv": cv2.__version__,
            "gl": gl,
        },
        "certificate": certificate,
    }


def rig_table(rig: StereoRig) -> dict[str, Any]:
    """Return a rig as JSON-ready content; its line time is in the settings and sensor.yaml."""
    table = {**asdict(rig), "T_body_cam": rig.T_body_cam.tolist()}
    del table["line_time_s"]
    return table
