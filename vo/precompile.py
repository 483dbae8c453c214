"""Compilation of the estimator ahead of its first frame, in two processes.

Without machine code on the disk, the functions would be compiled one after the other as frames call
them. Here a second process compiles what synthetic frames call, while this one compiles pose and
refinement; each finds what the other kept. The halves take about as long.
"""

import fcntl
import gc
import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from itertools import islice
from pathlib import Path

import numpy as np

from vo.bundle_adjustment.adjust import refine_motion, refine_structure
from vo.bundle_adjustment.joint import optimize_jointly
from vo.bundle_adjustment.problem import Bundle
from vo.config import MatchingSettings, MotionSettings, OdometrySettings, RefinementSettings
from vo.contract.arrays import Array, Image
from vo.contract.compilation import is_kept
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.odometry import StereoOdometry
from vo.pose.estimation import METHODS, estimate_pose
from vo.pose.hypotheses import Problem
from vo.pose.ransac import Consensus, search_adaptive

RIG = StereoRig(320, 240, 230.0, 159.5, 119.5, 0.09)
FRAMES = 12
DISPARITY_PX, STEP_PX = 10, 3
"""Disparity of the synthetic wall, and its motion from frame to frame."""

LAST = search_adaptive, optimize_jointly
"""What pose and refinement end with; a function that nothing calls would never be kept."""


@cache
def compile_ahead() -> None:
    """Compile the estimator's functions, unless their machine code is kept already.

    It looks once in a process. Of several processes of a user and an installation, the first
    compiles and the others wait.
    """
    if _is_compiled():
        return
    package = hashlib.sha256(str(Path(__file__).parent).encode()).hexdigest()[:12]
    lock = Path(tempfile.gettempdir()) / f"driftyard-{os.getuid()}-{package}.lock"
    with lock.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        if not _is_compiled():
            _compile()


def _is_compiled() -> bool:
    return all(map(is_kept, LAST))


def _compile() -> None:
    with (
        _without_garbage_collection(),
        subprocess.Popen([sys.executable, "-m", "vo.precompile"], stderr=subprocess.DEVNULL),
    ):
        _refine()
        _estimate()
    _track()


@contextmanager
def _without_garbage_collection() -> Generator[None]:
    """Keep Python from its search for cycles, which takes a sixth of the time of compilation."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _track() -> None:
    """Track synthetic frames, also as is done where displacements fail."""
    by_features = OdometrySettings(matching=MatchingSettings(search="features"))
    for settings, count in ((OdometrySettings(), FRAMES), (by_features, 2)):
        estimator = StereoOdometry(RIG, settings)
        for frame in islice(_frames(), count):
            estimator.track(frame)


def _refine() -> None:
    """Refine one camera, and two with their points."""
    points, measured = _points()
    settings = RefinementSettings()
    sigma = np.ones((len(points), 3))
    refine_motion(np.eye(4), points, measured, sigma, RIG, settings)
    bundle = Bundle(
        T_world_cam=np.tile(np.eye(4), (2, 1, 1)),
        points_world=points,
        camera=np.repeat([0, 1], len(points)),
        point=np.tile(np.arange(len(points)), 2),
        measured=np.tile(measured, (2, 1)),
        sigma=np.tile(sigma, (2, 1)),
        fixed=np.array([True, False]),
        K=RIG.K,
        baseline_m=RIG.baseline_m,
    )
    refine_structure(bundle, settings)


def _estimate() -> None:
    """Estimate a pose by P3P under RANSAC."""
    points, measured = _points()
    rays = RIG.normalized(measured[:, :2])
    estimate_pose(points, rays, points, MotionSettings(), np.random.default_rng(0))


def _points() -> tuple[Array, Array]:
    """Points (N, 3) ahead of a camera, metres, and their measurements (N, 3), pixels."""
    measured = np.random.default_rng(0).uniform((20, 20, 5), (300, 220, 20), (60, 3))
    return RIG.triangulate(measured[:, :2], measured[:, 2]), measured


def _frames() -> list[StereoFrame]:
    """Frames of a textured wall that passes by."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(40, 215, (60, 110))
    wall = np.kron(coarse, np.ones((4, 4)))

    def cut(shift: int) -> Image:
        smooth = sum(wall[v : v + 236, u + shift : u + shift + 320] for v in (0, 2) for u in (0, 2))
        return np.ascontiguousarray(smooth / 4).astype(np.uint8)

    starts = [STEP_PX * k for k in range(FRAMES)]
    return [
        StereoFrame(100_000_000 * k, cut(u), cut(u + DISPARITY_PX), (u, u))
        for k, u in enumerate(starts)
    ]


def _predicted(
    problem: Problem, T_odom_guess: Array, settings: MotionSettings, rng: np.random.Generator
) -> Consensus:
    """Take the predicted pose, in place of RANSAC, which the other process compiles."""
    return Consensus(T_odom_guess, np.ones(len(problem.points_odom), np.bool_))


if __name__ == "__main__":
    METHODS[MotionSettings().method] = _predicted
    with _without_garbage_collection():
        _track()
