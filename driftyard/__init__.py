"""driftyard: a proving ground for stereo visual odometry.

Everything that a user needs is here, and is imported on first use:

>>> import driftyard as dy
>>> ds = dy.open("ds")
>>> run = dy.run(ds, "corner_flow")
>>> score = dy.score(ds, run)
>>> 0 < score.drift_pct < 20
True

Lengths are in metres, timestamps in integer nanoseconds at the middle of the exposure, pixels
are (u, v) with centres on integers. `T_a_b` maps points from frame b to frame a. Frames are
`world` (z up), `body` (the carrier: x forward, z up), `cam` (rectified left camera: x right, y
down, z forward) and `odom` (the first `cam`). Every error that input can cause is a
`DriftyardError`; what deserves attention, without being an error, is issued as a warning.

Importing the package registers the Gymnasium environments, which
`gymnasium.make("driftyard:driftyard/RoverNav-v0")` makes.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from driftyard.environments import register_environments

__version__ = "0.1.0"

if TYPE_CHECKING:
    from driftyard import torch as torch
    from driftyard.benchmarking import benchmark, compare_systems
    from driftyard.calibrating import calibrate
    from driftyard.dataset import Dataset, open
    from driftyard.estimation import Run, make_estimator, open_run, run
    from driftyard.exporting import export
    from driftyard.fetching import fetch
    from driftyard.figures import Plot, plot, report
    from driftyard.gating import GateResult, gate
    from driftyard.geometry import boxes, occupancy, point_cloud
    from driftyard.motion import Flow, flow, tracks
    from driftyard.realism import compare, degrade, match
    from driftyard.recording import cameras, record, scenes
    from driftyard.scoring import score
    from driftyard.viewing import view
    from sim.graphics import GraphicsError
    from sim.truth.boxes import Box
    from sim.truth.clouds import PointCloud
    from sim.truth.occupancy import Occupancy
    from sim.truth.tracks import Tracks
    from trials.diagnosis.hooks import Oracle
    from trials.estimators.plugins import PluginError
    from trials.estimators.plugins.command import Command
    from trials.evaluation.score import Score
    from trials.gym.env.policies import NavigatorPolicy
    from trials.gym.media import Filmed
    from trials.realism.camera_estimates import CameraSetting
    from trials.realism.camera_match import CameraMatch
    from trials.realism.comparison import Comparison, Distance
    from vo.contract.errors import (
        CalibrationError,
        DatasetError,
        DriftyardError,
        FrameIndexError,
        ImageError,
        SettingsError,
        TrajectoryError,
    )
    from vo.contract.estimator import Estimate, FinalResult, PointMap, Status
    from vo.contract.inertial import ImuLog
    from vo.contract.observations import Observations
    from vo.contract.rig import StereoRig
    from vo.contract.sequence import StereoFrame, WheelLog
    from vo.contract.settings import Settings
    from vo.contract.trajectory import Trajectory
    from vo.hooks import Hooks
    from vo.odometry import StereoOdometry
    from vo.recording_calibration import Calibration

_HOMES = {
    "driftyard.benchmarking": ("benchmark", "compare_systems"),
    "driftyard.calibrating": ("calibrate",),
    "driftyard.dataset": ("Dataset", "open"),
    "driftyard.estimation": ("Run", "make_estimator", "open_run", "run"),
    "driftyard.exporting": ("export",),
    "driftyard.fetching": ("fetch",),
    "driftyard.figures": ("Plot", "plot", "report"),
    "driftyard.gating": ("GateResult", "gate"),
    "driftyard.geometry": ("boxes", "occupancy", "point_cloud"),
    "driftyard.motion": ("Flow", "flow", "tracks"),
    "driftyard.realism": ("compare", "degrade", "match"),
    "driftyard.recording": ("cameras", "record", "scenes"),
    "driftyard.scoring": ("score",),
    "driftyard.viewing": ("view",),
    "sim.graphics": ("GraphicsError",),
    "sim.truth.boxes": ("Box",),
    "sim.truth.clouds": ("PointCloud",),
    "sim.truth.occupancy": ("Occupancy",),
    "sim.truth.tracks": ("Tracks",),
    "trials.diagnosis.hooks": ("Oracle",),
    "trials.estimators.plugins": ("PluginError",),
    "trials.estimators.plugins.command": ("Command",),
    "trials.evaluation.score": ("Score",),
    "trials.gym.env.policies": ("NavigatorPolicy",),
    "trials.gym.media": ("Filmed",),
    "trials.realism.camera_estimates": ("CameraSetting",),
    "trials.realism.comparison": ("Comparison", "Distance"),
    "trials.realism.camera_match": ("CameraMatch",),
    "vo.contract.errors": (
        *("CalibrationError", "DatasetError", "DriftyardError", "FrameIndexError"),
        *("ImageError", "SettingsError", "TrajectoryError"),
    ),
    "vo.contract.estimator": ("Estimate", "FinalResult", "PointMap", "Status"),
    "vo.contract.inertial": ("ImuLog",),
    "vo.contract.observations": ("Observations",),
    "vo.contract.rig": ("StereoRig",),
    "vo.contract.sequence": ("StereoFrame", "WheelLog"),
    "vo.contract.settings": ("Settings",),
    "vo.contract.trajectory": ("Trajectory",),
    "vo.hooks": ("Hooks",),
    "vo.odometry": ("StereoOdometry",),
    "vo.recording_calibration": ("Calibration",),
}
"""Module to the public names that it defines."""
_MODULES = ("torch",)
"""Modules with public names of their own."""
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "Box",
    "Calibration",
    "CalibrationError",
    "CameraMatch",
    "CameraSetting",
    "Command",
    "Comparison",
    "Dataset",
    "DatasetError",
    "Distance",
    "DriftyardError",
    "Estimate",
    "Filmed",
    "FinalResult",
    "Flow",
    "FrameIndexError",
    "GateResult",
    "GraphicsError",
    "Hooks",
    "ImageError",
    "ImuLog",
    "NavigatorPolicy",
    "Observations",
    "Occupancy",
    "Oracle",
    "Plot",
    "PluginError",
    "PointCloud",
    "PointMap",
    "Run",
    "Score",
    "Settings",
    "SettingsError",
    "Status",
    "StereoFrame",
    "StereoOdometry",
    "StereoRig",
    "Tracks",
    "Trajectory",
    "TrajectoryError",
    "WheelLog",
    "__version__",
    "benchmark",
    "boxes",
    "calibrate",
    "cameras",
    "compare",
    "compare_systems",
    "degrade",
    "export",
    "fetch",
    "flow",
    "gate",
    "make_estimator",
    "match",
    "occupancy",
    "open",
    "open_run",
    "plot",
    "point_cloud",
    "record",
    "report",
    "run",
    "scenes",
    "score",
    "tracks",
    "view",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _MODULES:
            return import_module(f"driftyard.{name}")
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        try:
            home = import_module(_MODULE_OF[name])
        except Exception as error:  # of MuJoCo, which loads an OpenGL driver when it is imported
            from driftyard.failures import as_driftyard_error

            if (stated := as_driftyard_error(error)) is None:
                raise
            raise stated from error
        return globals().setdefault(name, getattr(home, name))

    def __dir__() -> list[str]:
        return sorted({*globals(), *_MODULE_OF, *_MODULES})


register_environments()
