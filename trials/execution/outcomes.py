"""What an experiment is made of: recordings, variants of an estimator, and what came of them."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np

from trials.evaluation.alignment import Pair, associate
from trials.evaluation.runs import FrameTable, SavedRun, Tracks, read_run
from trials.evaluation.score import Score, score_run
from vo.contract.arrays import Array
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status
from vo.contract.readers import read_truth
from vo.contract.trajectory import Trajectory


@dataclass(frozen=True)
class Recording:
    """A drive to record.

    Attributes:
        scene: Name.
        seed: Of everything random in it.
        overrides: `key=value` each, of the generator's settings.
        disturb: Disturbances, as for `driftyard generate`.
    """

    scene: str
    seed: int
    overrides: tuple[str, ...] = ()
    disturb: str = ""


@dataclass(frozen=True)
class Variant:
    """A way to run an estimator.

    Attributes:
        label: In tables and figures.
        estimator: Name, as for `driftyard run`.
        overrides: `key=value` each, of the estimator's settings.
        command: A program instead, as for `driftyard run --command`; empty for none.
    """

    label: str
    estimator: str = "driftyard"
    overrides: tuple[str, ...] = ()
    command: str = ""


@dataclass(frozen=True)
class Trial:
    """One recording and one way to run over it."""

    recording: Recording
    variant: Variant


@dataclass(frozen=True)
class Outcome:
    """What came of a trial.

    Attributes:
        trial: Which.
        dataset: Folder of the recording.
        file: Trajectory of the run; its companions lie beside it.
    """

    trial: Trial
    dataset: Path
    file: Path

    @cached_property
    def run(self) -> SavedRun:
        """The run, read back."""
        return read_run(self.file)

    @cached_property
    def frames(self) -> FrameTable:
        """What was said of every frame."""
        assert self.run.frames is not None  # our own runs always write it
        return self.run.frames

    @cached_property
    def tracks(self) -> Tracks:
        """The visibility mask."""
        assert self.run.tracks is not None
        return self.run.tracks

    @cached_property
    def truth(self) -> Trajectory:
        """True T_world_cam."""
        truth = read_truth(self.dataset)
        assert truth is not None  # our own recordings always hold it
        return truth

    @property
    def path_m(self) -> float:
        """Length of the true path, which may have more samples than the recording has frames."""
        steps = np.diff(self.truth.T_ref_frame[:, :3, 3], axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())

    @cached_property
    def pair(self) -> Pair:
        """Truth and estimate at the frames that have a pose.

        Raises:
            TrajectoryError: If there are fewer than two.
        """
        return associate(self.truth, self.run.trajectory)

    @cached_property
    def score(self) -> Score | None:
        """None for a run with fewer than two poses."""
        try:
            return score_run(self.truth, self.run, len(self.frames))
        except TrajectoryError:
            return None

    @property
    def drift_percent(self) -> float:
        """Mean drift over 1 m; NaN if there is none to speak of."""
        drift = self.score.drift_1m if self.score else None
        return drift.mean_percent if drift else np.nan

    @property
    def turn_deg_per_m(self) -> float:
        """Mean rotation error over 1 m; NaN like the drift."""
        drift = self.score.drift_1m if self.score else None
        return drift.mean_deg_per_m if drift else np.nan

    @property
    def lost_frames(self) -> int:
        """Number of frames without a pose."""
        return sum(status is Status.LOST for status in self.frames.status)

    @property
    def lost_share(self) -> float:
        """Share of the frames without a pose."""
        return self.lost_frames / len(self.frames)

    @property
    def time_s(self) -> Array:
        """(N,) seconds of every frame since the first."""
        times = self.frames.timestamps_ns
        return (times - times[0]) * 1e-9


@dataclass(frozen=True)
class Outcomes:
    """All that came of an experiment's trials, to be asked by recording and variant."""

    by_trial: dict[Trial, Outcome]

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """In the order of the trials, each once."""
        return tuple(dict.fromkeys(trial.recording for trial in self.by_trial))

    def at(self, recording: Recording, variant: Variant) -> Outcome:
        """Return what came of one trial."""
        return self.by_trial[Trial(recording, variant)]

    def of(self, variant: Variant, scene: str = "") -> list[Outcome]:
        """Return those of a variant, of one scene or of all, in the order of the recordings."""
        return [
            outcome
            for trial, outcome in self.by_trial.items()
            if trial.variant == variant and scene in ("", trial.recording.scene)
        ]

    def drifts(self, variant: Variant, scene: str = "") -> Array:
        """Drift over 1 m, %, of a variant's runs (N,), in the order of `of`; NaN for none."""
        return np.array([x.drift_percent for x in self.of(variant, scene)])


def crossed(recordings: Iterable[Recording], variants: Iterable[Variant]) -> list[Trial]:
    """Every recording with every variant."""
    return [Trial(*both) for both in product(recordings, variants)]
