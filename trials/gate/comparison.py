"""Run of the gate: record, check that sequences are comparable, measure, decide."""

import json
import platform
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenes.custom import is_custom
from trials.estimators.choice import Named
from trials.execution.cache import source_digest
from trials.gate.baseline import Baseline, Design, Measurement, Recorded, Rules, read_baseline
from trials.gate.decision import Decision, decide
from trials.gate.measure import measure
from trials.gate.scene_changes import SceneChange, scene_changes
from trials.gate.sequences import Bar, content_hashes, obtain, software
from vo.contract.errors import DatasetError, SettingsError
from vo.runner import companion

if TYPE_CHECKING:
    from trials.estimators.plugins.command import Command

PLATFORM = f"{platform.system()} {platform.machine()}"
"""Operating system and processor architecture."""
MISMATCHES = ("datasets", "platform")
"""Differences from the baseline that must be accepted explicitly."""


@dataclass(frozen=True)
class Comparison:
    """Result of a candidate, with its resolved settings, against a baseline.

    Attributes:
        software: Versions and OpenGL driver of this run.
        measured: Measurement of the candidate on each sequence of the baseline.
        mismatches: Accepted differences from the baseline.
    """

    baseline: Baseline
    estimator: str
    settings: Mapping[str, Any]
    software: Mapping[str, Any]
    measured: Sequence[Measurement]
    decision: Decision
    mismatches: tuple[str, ...]

    @cached_property
    def scene_changes(self) -> list[SceneChange]:
        """Change of the drift in each scene."""
        known = self.baseline
        return scene_changes(known.rules, known.scenes, known.measured, self.measured)


def make_baseline(
    choice: "Named | Command", reference: str, rules: Rules, design: Design, cache: Path, bar: Bar
) -> Baseline:
    """Measure an estimator as a baseline.

    Raises:
        DriftyardError: If design or estimator are wrong, or it fails on every sequence.
    """
    datasets, runs = obtain(design, cache, bar)
    with bar(f"running {choice.name}", len(datasets)) as count:
        measured = measure(choice, Named(reference), datasets, runs, count)
    settings, versions = _provenance(datasets, runs, measured)
    rows = zip(design.sequences, content_hashes(datasets), measured, strict=True)
    return Baseline(
        estimator=choice.name,
        settings=settings,
        reference=reference,
        rules=rules,
        design=design,
        platform=PLATFORM,
        generator=source_digest(),
        software=versions,
        sequences=tuple(
            Recorded(scene=scene, seed=seed, sha256=sha256, measured=x)
            for (scene, seed), sha256, x in rows
        ),
    )


def compare(
    path: Path, choice: "Named | Command", accepted: Collection[str], cache: Path, bar: Bar
) -> Comparison:
    """Run a candidate over the sequences of the baseline in a file, and decide.

    Raises:
        DriftyardError: If the baseline is invalid, sequences or platform differ from it and this
            kind of MISMATCHES is not accepted, or the estimator is wrong or fails on every
            sequence.
    """
    for name in accepted:
        if name not in MISMATCHES:
            raise SettingsError(f"--accept: unknown {name}; valid: {', '.join(MISMATCHES)}")
    baseline = read_baseline(path)
    same = baseline.platform == PLATFORM
    here = "" if same else f"platform is {PLATFORM}, was {baseline.platform}"
    refuse(path, "platform", here, accepted)
    try:
        datasets, runs = obtain(baseline.design, cache, bar)
    except SettingsError as error:  # such as an earlier name of a setting
        raise SettingsError(f"{path}: {error}; run `driftyard gate update`") from None
    rendered = software(datasets[0])
    other = dataset_mismatch(baseline, content_hashes(datasets), source_digest(), rendered)
    refuse(path, "datasets", other, accepted)
    with bar(f"running {choice.name}", len(datasets)) as count:
        found = measure(choice, Named(baseline.reference), datasets, runs, count)
    measured = [x.held_to(known) for x, known in zip(found, baseline.measured, strict=True)]
    settings, versions = _provenance(datasets, runs, measured)
    decision = decide(baseline.rules, baseline.scenes, baseline.measured, measured)
    mismatches = tuple(x for x in (here, other) if x)
    return Comparison(baseline, choice.name, settings, versions, measured, decision, mismatches)


def _provenance(
    datasets: Sequence[Path], runs: Sequence[Path], measured: Sequence[Measurement]
) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Read settings and software from the first run that succeeded and its dataset."""
    rows = zip(datasets, runs, measured, strict=True)
    dataset, run = next((x, run) for x, run, found in rows if not found.problem)
    about = json.loads(companion(run, "run.json").read_text(encoding="utf-8"))
    return about["settings"], {**about["versions"], **software(dataset)}


def dataset_mismatch(
    baseline: Baseline, hashes: Sequence[str], generator: str, versions: Mapping[str, Any]
) -> str:
    """Describe how the sequences differ from the baseline, with likely causes; empty if equal.

    The arguments are hashes of the contents of its sequences, the digest of the generator's
    sources, and versions and OpenGL driver, all of them here.
    """
    pairs = list(zip(baseline.sequences, hashes, strict=True))
    other = [known for known, sha256 in pairs if known.sha256 != sha256]
    if not other:
        return ""
    first = other[0].scene
    if first in baseline.design.recordings:
        return f"datasets differ in {len(other)} of {len(pairs)} sequences, the first {first}"
    causes = [] if generator == baseline.generator else ["the generator's sources changed"]
    for name, now in versions.items():
        was = baseline.software.get(name)
        if was != now:
            causes.append(f"{name} is {_version(now)}, was {_version(was)}")
    if not causes and is_custom(first):
        causes.append(f"{first} was edited")
    why = f" ({'; '.join(causes)})" if causes else ""
    return (
        f"datasets differ in {len(other)} of {len(pairs)} sequences, the first {first} "
        f"seed {other[0].seed}{why}"
    )


def refuse(path: Path, kind: str, mismatch: str, accepted: Collection[str]) -> None:
    """Raise DatasetError for a mismatch of a kind that is not accepted."""
    if mismatch and kind not in accepted:
        raise DatasetError(f"{path}: {mismatch}; run `driftyard gate update`, or --accept {kind}")


def _version(version: Any) -> str:
    return version.get("renderer", "?") if isinstance(version, dict) else str(version)
