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
    from driftyard.dataset import Dataset as Dataset
    from driftyard.dataset import open as open
    from driftyard.estimation import Run as Run
    from driftyard.estimation import make_estimator as make_estimator
    from driftyard.estimation import open_run as open_run
    from driftyard.estimation import run as run
    from driftyard.figures import Plot as Plot
    from driftyard.figures import plot as plot
    from driftyard.figures import report as report
    from driftyard.gating import GateResult as GateResult
    from driftyard.gating import gate as gate
    from driftyard.recording import record as record
    from driftyard.recording import scenes as scenes
    from driftyard.scoring import score as score
    from trials.estimators.plugins import PluginError as PluginError
    from trials.estimators.plugins.command import Command as Command
    from trials.evaluation.score import Score as Score
    from vo.contract.errors import CalibrationError as CalibrationError
    from vo.contract.errors import DatasetError as DatasetError
    from vo.contract.errors import DriftyardError as DriftyardError
    from vo.contract.errors import ImageError as ImageError
    from vo.contract.errors import SettingsError as SettingsError
    from vo.contract.errors import TrajectoryError as TrajectoryError
    from vo.contract.estimator import Estimate as Estimate
    from vo.contract.estimator import Status as Status
    from vo.contract.inertial import ImuLog as ImuLog
    from vo.contract.rig import StereoRig as StereoRig
    from vo.contract.sequence import StereoFrame as StereoFrame
    from vo.contract.sequence import WheelLog as WheelLog
    from vo.contract.trajectory import Trajectory as Trajectory
    from vo.odometry import StereoOdometry as StereoOdometry

_HOMES = {
    "driftyard.dataset": ("Dataset", "open"),
    "driftyard.estimation": ("Run", "make_estimator", "open_run", "run"),
    "driftyard.figures": ("Plot", "plot", "report"),
    "driftyard.gating": ("GateResult", "gate"),
    "driftyard.recording": ("record", "scenes"),
    "driftyard.scoring": ("score",),
    "trials.estimators.plugins": ("PluginError",),
    "trials.estimators.plugins.command": ("Command",),
    "trials.evaluation.score": ("Score",),
    "vo.contract.errors": (
        *("CalibrationError", "DatasetError", "DriftyardError"),
        *("ImageError", "SettingsError", "TrajectoryError"),
    ),
    "vo.contract.estimator": ("Estimate", "Status"),
    "vo.contract.inertial": ("ImuLog",),
    "vo.contract.rig": ("StereoRig",),
    "vo.contract.sequence": ("StereoFrame", "WheelLog"),
    "vo.contract.trajectory": ("Trajectory",),
    "vo.odometry": ("StereoOdometry",),
}
"""Module to the public names that it defines."""
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "CalibrationError",
    "Command",
    "Dataset",
    "DatasetError",
    "DriftyardError",
    "Estimate",
    "GateResult",
    "ImageError",
    "ImuLog",
    "Plot",
    "PluginError",
    "Run",
    "Score",
    "SettingsError",
    "Status",
    "StereoFrame",
    "StereoOdometry",
    "StereoRig",
    "Trajectory",
    "TrajectoryError",
    "WheelLog",
    "__version__",
    "gate",
    "make_estimator",
    "open",
    "open_run",
    "plot",
    "record",
    "report",
    "run",
    "scenes",
    "score",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *_MODULE_OF})


register_environments()
