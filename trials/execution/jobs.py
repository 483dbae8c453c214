"""Jobs of an experiment, each a recording and a variant of an estimator, and their results."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np

from sim.camera_names import DEFAULT_CAMERA
from trials.evaluation.alignment import Pair, associate
from trials.evaluation.consistency import Nees, consistency_of
from trials.evaluation.runs import FrameTable, SavedRun, Tracks, read_run
from trials.evaluation.score import Score, score_run
from trials.evaluation.truth import true_trajectory
from trials.evaluation.wrong_steps import WrongSteps, count_wrong_steps
from vo.contract.arrays import Array
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status
from vo.contract.trajectory import Trajectory


def scene_label(scene: str) -> str:
    """Return the part of a file's name that stands for a scene: of an MJCF file, its stem."""
    path = Path(scene)
    label = path.stem if path.suffix.lower() in (".xml", ".mjcf") else scene
    return label.replace(":", ".").replace("/", ".")


@dataclass(frozen=True)
class Recording:
    """A drive through a scene that is recorded; the rest is as for `driftyard generate`."""

    scene: str
    seed: int
    overrides: tuple[str, ...] = ()
    disturb: str = ""
    camera: str = DEFAULT_CAMERA

    @property
    def name(self) -> str:
        """Name in files and messages: scene and seed."""
        return f"{scene_label(self.scene)}-{self.seed}"


@dataclass(frozen=True)
class Variant:
    """An estimator with its settings, or a program, as for `driftyard run`.

    Attributes:
        label: Name in tables and figures.
        estimator: Name.
        overrides: `key=value` each.
        command: A program instead; empty for none.
        repeat: Number of the run, of an estimator whose results vary.
    """

    label: str
    estimator: str = "driftyard"
    overrides: tuple[str, ...] = ()
    command: str = ""
    repeat: int = 0


@dataclass(frozen=True)
class Job:
    """One recording and the variant that is run over it."""

    recording: Recording
    variant: Variant


@dataclass(frozen=True)
class Result:
    """Result of a job: folder of the recording and trajectory, with companion files beside it."""

    job: Job
    dataset: Path
    file: Path

    @cached_property
    def run(self) -> SavedRun:
        """Trajectory, frames and tracks, read from the files."""
        return read_run(self.file)

    @cached_property
    def frames(self) -> FrameTable:
        """Status, counts and times of every frame."""
        assert self.run.frames is not None  # our own runs always write it
        return self.run.frames

    @cached_property
    def tracks(self) -> Tracks:
        """Observations of landmarks by frames."""
        assert self.run.tracks is not None
        return self.run.tracks

    @cached_property
    def truth(self) -> Trajectory:
        """True T_world_cam."""
        return true_trajectory(self.dataset)

    @property
    def path_m(self) -> float:
        """Length of the true path at the rate of the truth."""
        steps = np.diff(self.truth.T_ref_frame[:, :3, 3], axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())

    @cached_property
    def pair(self) -> Pair:
        """True and estimated poses of the frames that have an estimate.

        Raises:
            TrajectoryError: If there are fewer than two.
        """
        return associate(self.truth, self.run.trajectory)

    @cached_property
    def score(self) -> Score | None:
        """Errors of the run; None with fewer than two poses."""
        try:
            return score_run(self.truth, self.run, len(self.frames))
        except TrajectoryError:
            return None

    @cached_property
    def wrong_steps(self) -> WrongSteps:
        """Numbers of steps that are wrong, in silence or not."""
        return count_wrong_steps(self.truth, self.run)

    @cached_property
    def nees(self) -> Nees | None:
        """Normalised errors; None without covariances, or with fewer than two poses."""
        return consistency_of(self.truth, self.run)

    @property
    def drift_percent(self) -> float:
        """Mean translation drift over 1 m, %; NaN if undefined."""
        drift = self.score.drift_1m if self.score else None
        return drift.mean_percent if drift else np.nan

    @property
    def rotation_deg_per_m(self) -> float:
        """Mean rotation error over 1 m, deg/m; NaN if undefined."""
        drift = self.score.drift_1m if self.score else None
        return drift.mean_deg_per_m if drift else np.nan

    @property
    def lost_frames(self) -> int:
        """Number of frames without a pose."""
        return sum(status is Status.LOST for status in self.frames.status)

    @property
    def lost_share(self) -> float:
        """Ratio of frames without a pose to all frames."""
        return self.lost_frames / len(self.frames)

    @property
    def time_s(self) -> Array:
        """(N,) seconds of every frame since the first."""
        times = self.frames.timestamps_ns
        return (times - times[0]) * 1e-9


@dataclass(frozen=True)
class Results:
    """Results of all jobs of an experiment, by recording and variant."""

    by_job: dict[Job, Result]

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """Recordings in the order of the jobs, each once."""
        return tuple(dict.fromkeys(job.recording for job in self.by_job))

    def at(self, recording: Recording, variant: Variant) -> Result:
        """Return the result of one job."""
        return self.by_job[Job(recording, variant)]

    def of(self, variant: Variant, scene: str = "") -> list[Result]:
        """Return the results of a variant on one scene or all, in the order of the recordings."""
        return [
            result
            for job, result in self.by_job.items()
            if job.variant == variant and scene in ("", job.recording.scene)
        ]

    def drifts(self, variant: Variant, scene: str = "") -> Array:
        """Drift over 1 m, %, of a variant's runs (N,), in the order of `of`; NaN if undefined."""
        return np.array([x.drift_percent for x in self.of(variant, scene)])


def jobs_of(recordings: Iterable[Recording], variants: Iterable[Variant]) -> list[Job]:
    """Combine every recording with every variant."""
    return [Job(*both) for both in product(recordings, variants)]
