"""Recordings of scenes that several test modules share."""

import fcntl
import os
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from scenes import build_scene
from sim.record import record
from sim.settings import DriveSettings, LabelSettings, RecordSettings, RenderSettings, RigSettings

OFFICE = RecordSettings(
    rig=RigSettings(width_px=320, height_px=240, rate_hz=7),
    drive=DriveSettings(distance_m=1.15, speed_mps=0.36),
    render=RenderSettings(samples=0, shadow_size_px=512),
    labels=LabelSettings(disparity=False, occlusion=True, flow=True, covisibility=True),
)
"""A short drive with labels of depth, as oracles need it, and what exports compare."""


def shared_recording(
    paths: pytest.TempPathFactory, scene: str, seed: int, settings: RecordSettings
) -> Path:
    """Return the dataset folder of a recording, which the first test that asks for it makes.

    All workers of pytest-xdist share one folder of recordings; tests must not change them.
    """
    base = paths.getbasetemp()
    root = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "recordings"
    root.mkdir(exist_ok=True)
    digest = sha256(f"{scene} {seed} {settings.model_dump_json()}".encode()).hexdigest()
    folder = root / f"{scene}-{digest[:12]}"
    with (root / f"{folder.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.is_dir():
            record(build_scene(scene, np.random.default_rng(seed), {}), settings, folder)
    return folder
