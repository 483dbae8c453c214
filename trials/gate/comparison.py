"""Run of the gate: record, check that sequences are comparable, measure, decide."""

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trials.estimators.choice import Named
from trials.execution.cache import source_digest
from trials.gate.baseline import (
    Baseline,
    Recorded,
    dataset_mismatch,
    platform_mismatch,
    refuse,
    this_platform,
)
from trials.gate.decision import Decision, decide
from trials.gate.design import Design, content_hashes, record
from trials.gate.measure import measure, run_file
from trials.gate.measurement import Measurement
from trials.gate.rules import Rules
from vo.contract.dataset import read_manifest
from vo.contract.errors import SettingsError
from vo.runner import companion

if TYPE_CHECKING:
    from trials.estimators.plugins.command import Command

Bar = Callable[[str, int], AbstractContextManager[Callable[[object], None]]]
"""Shows a progress bar with label and total; yields a function to call at each step."""


@dataclass(frozen=True)
class Comparison:
    """Result of a candidate against a baseline.

    Attributes:
        baseline: Baseline.
        estimator: Name of the candidate.
        settings: Resolved settings of the candidate.
        software: Versions and OpenGL driver of this run.
        measured: Measurement of the candidate on each sequence of the baseline.
        decision: Verdicts.
        mismatches: Accepted differences from the baseline.
    """

    baseline: Baseline
    estimator: str
    settings: Mapping[str, Any]
    software: Mapping[str, Any]
    measured: Sequence[Measurement]
    decision: Decision
    mismatches: tuple[str, ...]


def make_baseline(
    choice: "Named | Command", reference: str, rules: Rules, design: Design, cache: Path, bar: Bar
) -> Baseline:
    """Measure an estimator as a baseline.

    Raises:
        DriftyardError: If design or estimator are wrong, or it fails on every sequence.
    """
    with bar("recording", len(design.sequences)) as count:
        datasets = record(design, cache, count)
    with bar(f"running {choice.name}", len(datasets)) as count:
        measured = measure(choice, Named(reference), datasets, count)
    settings, software = _provenance(datasets, measured)
    rows = zip(design.sequences, content_hashes(datasets), measured, strict=True)
    return Baseline(
        estimator=choice.name,
        settings=settings,
        reference=reference,
        rules=rules,
        design=design,
        platform=this_platform(),
        generator=source_digest(),
        software=software,
        sequences=tuple(
            Recorded(scene=scene, seed=seed, sha256=sha256, measured=x)
            for (scene, seed), sha256, x in rows
        ),
    )


def compare(
    path: Path,
    baseline: Baseline,
    choice: "Named | Command",
    accepted: Collection[str],
    cache: Path,
    bar: Bar,
) -> Comparison:
    """Run a candidate over the sequences of a baseline and decide.

    Args:
        path: File of the baseline, for messages.
        baseline: Baseline.
        choice: Candidate.
        accepted: Kinds of MISMATCHES that are accepted.
        cache: Folder of recordings.
        bar: Shows progress.

    Raises:
        DriftyardError: If sequences or platform differ from the baseline, or the estimator is
            wrong or fails on every sequence.
    """
    platform = platform_mismatch(baseline)
    refuse(path, "platform", platform, accepted)
    with bar("recording", len(baseline.sequences)) as count:
        try:
            datasets = record(baseline.design, cache, count)
        except SettingsError as error:  # such as an earlier name of a setting
            raise SettingsError(f"{path}: {error}; run `driftyard gate update`") from None
    rendered: dict[str, Any] = read_manifest(datasets[0]).get("software", {})
    other = dataset_mismatch(baseline, content_hashes(datasets), source_digest(), rendered)
    refuse(path, "datasets", other, accepted)
    with bar(f"running {choice.name}", len(datasets)) as count:
        measured = measure(choice, Named(baseline.reference), datasets, count)
    settings, software = _provenance(datasets, measured)
    decision = decide(baseline.rules, baseline.scenes, baseline.measured, measured)
    mismatches = tuple(x for x in (platform, other) if x)
    return Comparison(baseline, choice.name, settings, software, measured, decision, mismatches)


def _provenance(
    datasets: Sequence[Path], measured: Sequence[Measurement]
) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Read settings and software from the first run that succeeded and its dataset."""
    dataset = next(x for x, found in zip(datasets, measured, strict=True) if not found.problem)
    about = json.loads(companion(run_file(dataset), "run.json").read_text(encoding="utf-8"))
    software = {**about["versions"], **read_manifest(dataset).get("software", {})}
    return about["settings"], software
