"""Runs of estimators over recordings."""

import shutil
import tempfile
import weakref
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from driftyard.dataset import Dataset, PathLike, dataset_of
from driftyard.failures import in_one_family
from driftyard.given_settings import GivenSettings, sources_of
from driftyard.notebook import data_frame, pose_columns
from trials.estimators.choice import Named, estimate
from trials.estimators.choice import make_estimator as build_estimator
from trials.estimators.plugins.command import Command
from trials.evaluation.covariances import read_covariances
from trials.evaluation.display import html_display, text_display
from trials.evaluation.runs import SavedRun, read_map, read_run
from trials.view.target import Target, target_of
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError, TrajectoryError
from vo.contract.estimator import Estimate, Estimator, PointMap
from vo.contract.rig import StereoRig
from vo.contract.trajectory import Trajectory
from vo.recordings.readers import read_frame_times
from vo.recordings.synchronization import remark_unsynchronized
from vo.recordings.trajectory_files import read_trajectory
from vo.runner import companion

if TYPE_CHECKING:
    import pandas as pd

    from trials.view.show import LiveView

Plugin = Callable[..., Estimator]
"""A class, or function, that is called with the rig, and its settings if it has some."""
AnyEstimator = str | Named | Command | Plugin
"""A name or `module:Class`, a program, or a class."""


@dataclass(frozen=True, repr=False, eq=False)
class Run(SavedRun):
    """An estimated trajectory, and what else the estimator said, in files beside it.

    Attributes:
        path: Trajectory file, TUM format.
        estimator: Name in tables.
        trajectory: T_odom_cam: `timestamps_ns` (M,) and poses `T_ref_frame` (M, 4, 4) of the
            frames that have one.
        frames: Status, reason, counts and milliseconds of every frame; None for a trajectory of
            another program.
        tracks: Observations of landmarks; None likewise.
        about: Estimator, settings, versions and recording; empty likewise.

    Example:
        >>> run = dy.run(ds, "corner_flow")
        >>> run.T_odom_cam.shape == (len(ds), 4, 4)
        True
        >>> sorted(set(run.table()["status"]))
        ['start', 'tracked']
    """

    @property
    def T_odom_cam(self) -> Array:
        """(M, 4, 4) poses of the left camera, metres."""
        return self.trajectory.T_ref_frame

    @cached_property
    def map(self) -> PointMap | None:
        """The estimated landmarks; None if the estimator keeps none."""
        file = companion(self.path, "map.ply")
        return read_map(file) if file.is_file() else None

    @cached_property
    def smoothed(self) -> Trajectory | None:
        """T_odom_cam, smoothed after the last frame; None if the estimator does not."""
        file = companion(self.path, "smoothed.txt")
        return read_trajectory(file) if file.is_file() else None

    def motion_covariance(self, start: int, end: int) -> Array:
        """Covariance (6, 6) of the motion from a pose (row) to a later one, in the latter's frame.

        Raises:
            TrajectoryError: If the estimator gave no covariances.
        """
        return read_covariances(self).of_motions(np.array([start]), np.array([end]))[0]

    def table(self) -> "pd.DataFrame":
        """Return times, poses, and status and ms of every frame as a pandas.DataFrame."""
        times_ns = self.trajectory.timestamps_ns
        columns: dict[str, Any] = {"timestamp_ns": times_ns}
        if self.frames is not None:
            columns = {
                "timestamp_ns": self.frames.timestamps_ns,
                "status": [x.value for x in self.frames.status],
                "reason": self.frames.reason,
                "frame_ms": self.frames.frame_ms,
            }
        rows = np.searchsorted(columns["timestamp_ns"], times_ns)
        poses = np.full((len(columns["timestamp_ns"]), 4, 4), np.nan)
        poses[rows] = self.T_odom_cam
        return data_frame(columns | pose_columns(poses))

    @property
    def _facts(self) -> list[tuple[str, str]]:
        facts = [("poses", f"{len(self.trajectory)}")]
        if self.frames is not None:
            facts += [
                (str(x), f"{self.frames.status.count(x)}")
                for x in dict.fromkeys(self.frames.status)
            ]
            facts.append(("ms per frame, median", f"{np.median(self.frames.frame_ms):.1f}"))
        return facts

    def __repr__(self) -> str:
        return text_display(f"Run of {self.estimator}", self._facts)

    def _repr_html_(self) -> str:
        return html_display(f"Run of {self.estimator}", self._facts)


@in_one_family
def run(
    dataset: Dataset | PathLike,
    estimator: AnyEstimator = "driftyard",
    out: PathLike | None = None,
    *,
    settings: GivenSettings = None,
    progress: Callable[[int, int], None] | None = None,
    view: bool | PathLike = False,
) -> Run:
    """Pass every frame of a recording to a new estimator, which sees neither truth nor labels.

    A warning says so if the eyes do not show the same moments, or images cannot be read.

    Args:
        dataset: An open recording, or its folder.
        estimator: `driftyard`, `thesis`, `corner_flow`, `module:Class`, a class (or function) that
            is called with the `StereoRig`, or a program as a `Command`.
        out: Trajectory file to write, with companion files beside it; by default, files that are
            removed with the run.
        settings: Values by name, nested or as `key.path`, or a TOML file; `driftyard settings
            estimator` lists them with units.
        progress: Called with the number of frames done and that of all frames.
        view: Whether to show each frame in Rerun's viewer as soon as it is estimated; or a file
            that ends in .rrd, or the address of a viewer, as for `driftyard.view`.

    Raises:
        SettingsError: If there is no such estimator, a key or value is not accepted, or there is
            no viewer.
        DatasetError: If the recording is invalid, or `out` cannot be written.
        PluginError: If an estimator of yours fails.

    Example:
        >>> dy.run(ds, "corner_flow", "corner_flow.txt", settings={"window_px": 17}).path.name
        'corner_flow.txt'
    """
    opened, choice = dataset_of(dataset), choice_of(estimator, settings)
    frames = opened.selection
    if isinstance(choice, Command) and (frames.first, frames.last, frames.every) != (0, None, 1):
        raise SettingsError(f"{choice.name}: a program reads all frames, not a selection of them")
    if out is not None and Path(out).is_dir():
        raise TrajectoryError(f"{out}: is a folder; expected the name of a trajectory file")
    target = target_of(None if view is True else view) if view is not False else None
    scratch = Path(tempfile.mkdtemp(prefix="driftyard-")) if out is None else None
    file = scratch / "run.txt" if scratch else Path(out or "")
    remark_unsynchronized(opened.sequence)
    try:
        made = _estimated(opened, choice, file, progress, target)
    finally:
        if scratch:
            with suppress(OSError):
                scratch.rmdir()  # an unfinished run is kept
    if scratch:
        weakref.finalize(made, shutil.rmtree, scratch, ignore_errors=True)
    return made


def _estimated(
    dataset: Dataset,
    choice: Named | Command,
    file: Path,
    progress: Callable[[int, int], None] | None,
    target: Target | None,
) -> Run:
    """Run an estimator, and show it at a target meanwhile."""
    done = count(1)
    with _live_view(dataset, choice.name, target) as live:

        def advance(found: Estimate) -> None:
            if live:
                live.add(found)
            if progress:
                progress(next(done), len(dataset))

        estimate(choice, dataset.path, file, advance, dataset.selection)
        made = open_run(file, dataset)
        if live:
            live.finish(made)
        return made


@contextmanager
def _live_view(dataset: Dataset, name: str, target: Target | None) -> "Generator[LiveView | None]":
    """Open a view of a run that begins; None without a target."""
    if target is None:
        yield None
        return
    from trials.view.show import live_view  # loads the simulator

    with live_view(dataset.path, dataset.selection, name, target) as live:
        yield live


@in_one_family
def make_estimator(
    rig: StereoRig, estimator: str | Plugin = "driftyard", *, settings: GivenSettings = None
) -> Estimator:
    """Build an estimator with settings of yours, to which frames are passed one by one.

    Args:
        rig: Calibration of the rectified pair.
        estimator: `driftyard`, `thesis`, `corner_flow`, `module:Class`, or a class.
        settings: As for `run`.

    Raises:
        SettingsError: If there is no such estimator, or a key or value is not accepted.
        PluginError: If a class cannot be built.

    Example:
        >>> odometry = dy.make_estimator(ds.rig, "thesis", settings={"seed": 1})
        >>> odometry.track(ds[0]).T_odom_cam.shape
        (4, 4)
    """
    choice = choice_of(estimator, settings)
    if isinstance(choice, Command):
        raise SettingsError(f"{choice.name}: a program reads whole recordings; pass it to `run`")
    return build_estimator(choice.name, rig, choice.config, choice.overrides, choice.plugin)[0]


@in_one_family
def open_run(path: PathLike, dataset: Dataset | PathLike | None = None) -> Run:
    """Open a trajectory file: of a run, or of any other program.

    Args:
        path: The file: TUM, EuRoC or KITTI format. The poses are those of the left camera (or of
            the body, if `score` is told so), in any fixed frame.
        dataset: The recording, whose times decide about the unit of time in the file.

    Raises:
        TrajectoryError: If it is missing or malformed, or a file beside it is damaged.

    Example:
        >>> dy.open_run("corner_flow.txt", ds).estimator
        'corner_flow'
    """
    folder = dataset.path if isinstance(dataset, Dataset) else dataset and Path(dataset)
    saved = read_run(Path(path), read_frame_times(folder) if folder else None)
    return Run(**{x.name: getattr(saved, x.name) for x in fields(saved)})


def run_of(run: SavedRun | PathLike, dataset: Dataset | PathLike) -> SavedRun:
    """Return a run, opened if it is a path."""
    return run if isinstance(run, SavedRun) else open_run(run, dataset)


def choice_of(estimator: AnyEstimator, settings: GivenSettings = None) -> Named | Command:
    """Return the choice of an estimator.

    Raises:
        SettingsError: If it is an instance, none of these, or settings are given twice.
    """
    config, overrides = sources_of(settings)
    if isinstance(estimator, str):
        return Named(estimator, config, overrides)
    if isinstance(estimator, Named | Command):
        if config or overrides:
            raise SettingsError(f"{estimator.name}: takes no further settings")
        return estimator
    if not isinstance(estimator, type) and hasattr(estimator, "track"):
        name = type(estimator).__name__
        raise SettingsError(f"{name}: pass the class, not an instance: each run needs a new one")
    if not callable(estimator):
        raise SettingsError(f"estimator {estimator!r}: expected a name, a class or a Command")
    name = getattr(estimator, "__qualname__", type(estimator).__name__)
    module = getattr(estimator, "__module__", "__main__")
    label = name if module == "__main__" else f"{module}:{name}"
    return Named(label, config, overrides, estimator)
