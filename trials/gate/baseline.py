"""Baseline file: measurements, sequences, software and rules of the decision."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from sim.camera_names import IDEAL
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.files import write_text
from vo.contract.settings import Settings, validated

KIND, SCHEMA_VERSION = "driftyard gate baseline", 1
MAX_LOST_RATIO = 0.02
"""Ratio of lost frames above which a sequence counts as lost."""
MIN_DRIFT_PERCENT = 1e-4
"""Smallest drift; smaller ones count as this, so that the logarithm is finite."""


class Rules(Settings):
    """Level, power, and relative increases; a margin of 0 disables time or NEES."""

    level: float = Field(default=0.05, gt=0, le=0.2)
    """False alarm rate for an estimator whose drift grew by the tolerance."""
    power: float = Field(default=0.8, ge=0.5, lt=1)
    """Probability of finding the smallest detectable change."""
    drift_tolerance: float = Field(default=0.005, ge=0, le=10)
    """Relative increase of drift; a regression if the lower confidence bound exceeds it."""
    drift_margin: float = Field(default=0.1, gt=0, le=10)
    """Relative increase of drift; a pass if the upper confidence bound is below it."""
    time_margin: float = Field(default=0.25, ge=0, le=10)
    """Tolerance and margin of the frame time over that of the reference estimator."""
    nees_margin: float = Field(default=0.5, ge=0, le=10)
    """Tolerance and margin of the distance of the NEES from its expectation."""

    @model_validator(mode="after")
    def _margin_is_beyond_tolerance(self) -> Self:
        if self.drift_margin <= self.drift_tolerance:
            raise ValueError("drift_margin: must exceed drift_tolerance")
        return self


class Design(Settings):
    """Every scene with every seed, and the settings of these drives; and recordings."""

    scenes: tuple[str, ...] = ()
    seeds: int = Field(default=1, ge=1)
    """Number of seeds of each scene."""
    first_seed: int = Field(default=0, ge=0)
    """Random seed of the first sequence of each scene."""
    camera: str = IDEAL
    """Camera, as for `driftyard generate`; baselines of earlier versions name none."""
    disturb: str = ""
    """Disturbances, as for `driftyard generate`."""
    overrides: tuple[str, ...] = ()
    """Settings of the drives, `key=value` each."""
    recordings: tuple[str, ...] = ()
    """Paths of recordings of any layout, from the working directory; each stands for a scene."""

    @model_validator(mode="after")
    def _has_sequences(self) -> Self:
        if not self.sequences:
            raise ValueError("scenes: none, and no recordings")
        if len(set(self.recordings)) < len(self.recordings):
            raise ValueError("recordings: one is named twice")
        return self

    @property
    def drives(self) -> tuple[tuple[str, int], ...]:
        """Scene and seed of each drive."""
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        return tuple((scene, seed) for scene in self.scenes for seed in seeds)

    @property
    def sequences(self) -> tuple[tuple[str, int], ...]:
        """Scene and seed of each sequence; path and 0 of recordings, which are the last."""
        return (*self.drives, *((x, 0) for x in self.recordings))


class Measurement(Settings):
    """Figures of one estimator on one sequence."""

    frames: int = Field(ge=1)
    """Number of frames."""
    lost_frames: int = Field(ge=0)
    """Number of frames without a pose, of those that the estimator claims."""
    unclaimed_frames: int = Field(default=0, ge=0)
    """Number of frames between the keyframes of a program that writes no other poses."""
    drift_percent: float | None = Field(default=None, ge=0)
    """Mean translation error over 1 m; none with too few poses."""
    frame_ms: float | None = Field(default=None, gt=0)
    """Median wall time of a frame."""
    reference_ms: float | None = Field(default=None, gt=0)
    """Median wall time of a frame of the reference estimator."""
    nees: float | None = Field(default=None, gt=0)
    """Median NEES of steps over its expected median; none without covariances."""
    problem: str = ""
    """Error of the estimator; empty if it succeeded."""

    @property
    def is_lost(self) -> bool:
        """Whether too many frames are lost, or the drift is undefined."""
        return self.drift_percent is None or self.lost_frames > MAX_LOST_RATIO * self.frames

    def held_to(self, baseline: "Measurement") -> "Measurement":
        """Count frames that are not claimed as lost if the baseline claims every frame."""
        if baseline.problem or baseline.unclaimed_frames:
            return self
        return self.model_copy(update={"lost_frames": self.lost_frames + self.unclaimed_frames})

    @property
    def log_drift(self) -> float:
        """Logarithm of the drift in percent; NaN if lost."""
        if self.is_lost or self.drift_percent is None:
            return math.nan
        return math.log(max(self.drift_percent, MIN_DRIFT_PERCENT))

    @property
    def log_time(self) -> float:
        """Logarithm of the frame time over that of the reference; NaN if unknown."""
        if self.frame_ms is None or self.reference_ms is None:
            return math.nan
        return math.log(self.frame_ms / self.reference_ms)

    @property
    def log_nees(self) -> float:
        """Logarithm of the NEES over its expectation, 0 if consistent; NaN if unknown."""
        return math.nan if self.nees is None else math.log(self.nees)


class Recorded(Settings):
    """Measurement of one sequence."""

    scene: str
    seed: int
    sha256: str
    """Hash of the contents of the dataset."""
    measured: Measurement


class Baseline(Settings):
    """Measurements that a candidate is compared with."""

    kind: Literal["driftyard gate baseline"] = KIND
    schema_version: Literal[1] = SCHEMA_VERSION
    estimator: str
    settings: Mapping[str, Any]
    """Resolved settings of the estimator."""
    reference: str
    """Reference estimator that normalizes frame times."""
    rules: Rules
    design: Design
    platform: str
    generator: str
    """Digest of the sources that recorded the sequences."""
    software: Mapping[str, Any]
    """Versions, and the OpenGL driver."""
    sequences: tuple[Recorded, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _is_of_its_design(self) -> Self:
        if tuple((x.scene, x.seed) for x in self.sequences) != self.design.sequences:
            raise ValueError("sequences: are not those of design")
        return self

    @property
    def measured(self) -> list[Measurement]:
        """Measurement of each sequence."""
        return [x.measured for x in self.sequences]

    @property
    def scenes(self) -> list[str]:
        """Scene of each sequence."""
        return [x.scene for x in self.sequences]


def read_baseline(path: Path) -> Baseline:
    """Read a baseline.

    Raises:
        DatasetError: If the file is missing, no baseline, or of another schema.
        SettingsError: If a value in it is not accepted.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise DatasetError(
            f"{path}: cannot be read ({error.strerror}); `driftyard gate update` writes one"
        ) from None
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise DatasetError(f"{path}: not a gate baseline")
    version = content.get("schema_version")
    if version != SCHEMA_VERSION:
        raise DatasetError(
            f"{path}: baseline of schema {version}, this program reads {SCHEMA_VERSION}; "
            "run `driftyard gate update`"
        )
    try:
        return validated(Baseline, content)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from None


def write_baseline(path: Path, baseline: Baseline) -> None:
    """Write a baseline, completely or not at all."""
    write_text(path, baseline.model_dump_json(indent=1) + "\n")
