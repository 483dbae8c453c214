"""Check of the manifest: its own digest, and what it states against settings and tables."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sim.certificate.trajectory_check import read_states
from sim.dataset.manifest import rig_table
from sim.imaging.lens import delivered_rig, miscalibration_rotation
from sim.sensors.inertial import ImuReadings, with_noise
from sim.settings import RecordSettings
from sim.world.random_streams import stream
from sim.world.rig import stereo_rig
from vo.contract.dataset import DIGEST, TRUTH, manifest_digest
from vo.recordings.euroc import open_euroc
from vo.recordings.tables import read_columns

RELATIVE = 1e-9
"""Tolerance of numbers that are computed anew."""


def check_digest(manifest: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with the digest of the manifest."""
    if DIGEST not in manifest:
        yield f"{DIGEST} is missing: recorded by an earlier version, or edited"
    elif manifest[DIGEST] != manifest_digest(manifest):
        yield f"differs from its own digest, {DIGEST}"


def check_statements(
    folder: Path, manifest: dict[str, Any], settings: RecordSettings
) -> Iterator[str]:
    """Yield which statements do not follow from settings, calibration and tables of the folder."""
    true, sequence = stereo_rig(settings.rig), open_euroc(folder)
    times_ns, poses, _ = read_states(folder / TRUTH / "data.csv")
    length_m = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    expected = {
        "seed": settings.seed,
        "frames": len(sequence),
        "dropped_frames": len(times_ns) - len(sequence),
        "path_length_m": round(length_m, 4),
        "complete": not manifest.get("ended"),
        "rig": rig_table(delivered_rig(true, settings.calibration)),
        "rig_true": {
            **rig_table(true),
            "R_nominal_right": miscalibration_rotation(settings.calibration).tolist(),
        },
    }
    for key, value in expected.items():
        yield from differences(key, manifest.get(key), value, RELATIVE)
    for key, value in rig_table(sequence.rig).items():
        stated = manifest.get("rig", {}).get(key)
        found = differences(f"rig.{key}", stated, value, RELATIVE)
        yield from (f"{x} from cam0/sensor.yaml" for x in found)
    yield from _check_seed(folder, settings)


def _check_seed(folder: Path, settings: RecordSettings) -> Iterator[str]:
    """Draw the biases of the inertial unit, which the seed determines, anew."""
    unit_ns, _, rest = read_states(folder / "mav0/imu0/truth.csv")
    middles_ns, _ = read_columns(folder / "mav0/imu0/data.csv")
    if len(unit_ns) != len(middles_ns) + 1:
        yield f"imu0 has {len(middles_ns)} readings between {len(unit_ns)} states"
        return
    zero = np.zeros((len(middles_ns), 3))
    still = ImuReadings(middles_ns, np.diff(unit_ns), zero, zero)
    _, biases = with_noise(still, settings.imu, stream(settings.seed, "imu"))
    at_states = np.stack([np.interp(unit_ns, middles_ns, b) for b in biases.T], axis=1)
    if not np.allclose(at_states, rest[:, 3:], rtol=1e-6, atol=1e-12):
        yield f"seed is {settings.seed}, by which the inertial unit has other biases"


def differences(name: str, stated: Any, found: Any, tolerance: float) -> Iterator[str]:
    """Yield where a stated JSON value differs from the one found; numbers by a tolerance."""
    if isinstance(found, dict) and isinstance(stated, dict):
        for key in sorted({*found, *stated}):
            yield from differences(f"{name}.{key}", stated.get(key), found.get(key), tolerance)
    elif isinstance(found, list) and isinstance(stated, list) and len(found) == len(stated):
        for k, pair in enumerate(zip(stated, found, strict=True)):
            yield from differences(f"{name}[{k}]", *pair, tolerance)
    elif isinstance(found, float) and isinstance(stated, int | float):
        if not abs(stated - found) <= tolerance * max(1.0, abs(found)):
            yield f"{name} is {stated!r}, recomputed {found!r}"
    elif stated != found or type(stated) is not type(found):
        yield f"{name} is {stated!r}, recomputed {found!r}"
