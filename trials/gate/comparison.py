"""Run of the gate: record, check that sequences are comparable, measure, decide."""

import hashlib
import json
import platform
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenes.custom import is_custom
from trials.estimators.choice import Named
from trials.execution.cache import source_digest
from trials.execution.jobs import Recording
from trials.execution.recording_settings import recording_settings
from trials.execution.runner import NO_LABELS, record_all
from trials.gate.baseline import Baseline, Design, Measurement, Recorded, Rules, read_baseline
from trials.gate.decision import Decision, decide
from trials.gate.measure import measure, run_file
from vo.contract.dataset import read_manifest
from vo.contract.errors import DatasetError, SettingsError
from vo.runner import companion

if TYPE_CHECKING:
    from trials.estimators.plugins.command import Command

Bar = Callable[[str, int], AbstractContextManager[Callable[[object], None]]]
"""Shows a progress bar with label and total; yields a function to call at each step."""
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


def make_baseline(
    choice: "Named | Command", reference: str, rules: Rules, design: Design, cache: Path, bar: Bar
) -> Baseline:
    """Measure an estimator as a baseline.

    Raises:
        DriftyardError: If design or estimator are wrong, or it fails on every sequence.
    """
    datasets = _record(design, cache, bar)
    with bar(f"running {choice.name}", len(datasets)) as count:
        measured = measure(choice, Named(reference), datasets, count)
    settings, software = _provenance(datasets, measured)
    rows = zip(design.sequences, _content_hashes(datasets), measured, strict=True)
    return Baseline(
        estimator=choice.name,
        settings=settings,
        reference=reference,
        rules=rules,
        design=design,
        platform=PLATFORM,
        generator=source_digest(),
        software=software,
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
        datasets = _record(baseline.design, cache, bar)
    except SettingsError as error:  # such as an earlier name of a setting
        raise SettingsError(f"{path}: {error}; run `driftyard gate update`") from None
    rendered: dict[str, Any] = read_manifest(datasets[0]).get("software", {})
    other = dataset_mismatch(baseline, _content_hashes(datasets), source_digest(), rendered)
    refuse(path, "datasets", other, accepted)
    with bar(f"running {choice.name}", len(datasets)) as count:
        found = measure(choice, Named(baseline.reference), datasets, count)
    measured = [x.held_to(known) for x, known in zip(found, baseline.measured, strict=True)]
    settings, software = _provenance(datasets, measured)
    decision = decide(baseline.rules, baseline.scenes, baseline.measured, measured)
    mismatches = tuple(x for x in (here, other) if x)
    return Comparison(baseline, choice.name, settings, software, measured, decision, mismatches)


def _provenance(
    datasets: Sequence[Path], measured: Sequence[Measurement]
) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Read settings and software from the first run that succeeded and its dataset."""
    dataset = next(x for x, found in zip(datasets, measured, strict=True) if not found.problem)
    about = json.loads(companion(run_file(dataset), "run.json").read_text(encoding="utf-8"))
    software = {**about["versions"], **read_manifest(dataset).get("software", {})}
    return about["settings"], software


def dataset_mismatch(
    baseline: Baseline, hashes: Sequence[str], generator: str, software: Mapping[str, Any]
) -> str:
    """Describe how the sequences differ from the baseline, with likely causes; empty if equal.

    The arguments are hashes of the contents of its sequences, the digest of the generator's
    sources, and versions and OpenGL driver, all of them here.
    """
    pairs = list(zip(baseline.sequences, hashes, strict=True))
    other = [known for known, sha256 in pairs if known.sha256 != sha256]
    if not other:
        return ""
    causes = [] if generator == baseline.generator else ["the generator's sources changed"]
    for name, now in software.items():
        was = baseline.software.get(name)
        if was != now:
            causes.append(f"{name} is {_version(now)}, was {_version(was)}")
    if not causes and is_custom(other[0].scene):
        causes.append(f"{other[0].scene} was edited")
    why = f" ({'; '.join(causes)})" if causes else ""
    return (
        f"datasets differ in {len(other)} of {len(pairs)} sequences, the first {other[0].scene} "
        f"seed {other[0].seed}{why}"
    )


def refuse(path: Path, kind: str, mismatch: str, accepted: Collection[str]) -> None:
    """Raise DatasetError for a mismatch of a kind that is not accepted."""
    if mismatch and kind not in accepted:
        raise DatasetError(f"{path}: {mismatch}; run `driftyard gate update`, or --accept {kind}")


def _version(version: Any) -> str:
    return version.get("renderer", "?") if isinstance(version, dict) else str(version)


def _record(design: Design, cache: Path, bar: Bar) -> list[Path]:
    """Record what is missing, on all cores; returns the dataset folder of each sequence."""
    overrides = (*NO_LABELS, *design.overrides)
    drives = [Recording(x, seed, overrides, design.disturb) for x, seed in design.sequences]
    with bar("recording", len(drives)) as count:
        for x in drives:  # refuses now what a worker would refuse
            recording_settings(x.scene, x.seed, x.overrides, None, x.disturb)
        folders: dict[int, Path] = {}
        for row, folder in record_all(drives, cache):
            folders[row] = folder
            count(folder)
    return [folders[row] for row in range(len(drives))]


def _content_hashes(datasets: Sequence[Path]) -> list[str]:
    """Hash the contents of datasets: all files but the manifest, which names the software."""
    hashes = [json.dumps(read_manifest(x)["sha256"], sort_keys=True) for x in datasets]
    return [hashlib.sha256(x.encode()).hexdigest() for x in hashes]
