"""Runs trials, two at a time, and keeps what came of them until something that made it changes."""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from trials.drives import fingerprint, is_recorded
from trials.experiments.trial import Outcome, Outcomes, Recording, Trial, Variant
from trials.workers import spread

ESTIMATOR = ("vo", "trials/baselines")
"""Folders of the sources that decide what an estimator says."""


def perform(
    trials: Sequence[Trial], cache: Path, progress: Callable[[object], None] = lambda _: None
) -> Outcomes:
    """Record what is missing, run what is missing, and return all.

    Args:
        trials: May share recordings; each is made once.
        cache: Folder of recordings and runs, each named after all that decides its content.
        progress: Called with every recording that is done with.

    Raises:
        DriftyardError: If a scene, setting or estimator is wrong.
    """
    variants: dict[Recording, list[Variant]] = {}
    for trial in trials:
        variants.setdefault(trial.recording, []).append(trial.variant)
    done: dict[Trial, Outcome] = {}
    calls = [(recording, of, cache) for recording, of in variants.items()]
    for _, outcomes in spread(run_over, calls):
        done |= {outcome.trial: outcome for outcome in outcomes}
        progress(outcomes)
    return Outcomes({trial: done[trial] for trial in trials})


def run_over(recording: Recording, variants: Sequence[Variant], cache: Path) -> list[Outcome]:
    """Record a drive unless it is there, and run every variant over it that has not been."""
    import cv2

    from trials.estimators import Named, estimate
    from trials.plugins.command import Command

    cv2.setNumThreads(1)
    dataset = recorded(recording, cache)
    outcomes: list[Outcome] = []
    for variant in variants:
        words = json.dumps([dataset.name, variant.estimator, variant.overrides, variant.command])
        key = hashlib.sha256((words + fingerprint(ESTIMATOR)).encode()).hexdigest()[:16]
        file = cache / "runs" / f"{key}.txt"
        if not file.is_file():  # it is written last, so what belongs to it is there too
            file.parent.mkdir(parents=True, exist_ok=True)
            choice = Named(variant.estimator, None, variant.overrides)
            if variant.command:
                choice = Command(variant.command, label=variant.label)
            estimate(choice, dataset, file)
        outcomes.append(Outcome(Trial(recording, variant), dataset, file))
    return outcomes


def recorded(recording: Recording, cache: Path) -> Path:
    """Return the folder of a drive, recorded now unless it is there."""
    from sim.batch import build
    from sim.record import record
    from trials.commands.datasets import record_settings

    settings = record_settings(
        recording.scene, recording.seed, list(recording.overrides), None, recording.disturb
    )
    words = settings.model_dump_json() + fingerprint()
    key = hashlib.sha256(words.encode()).hexdigest()[:12]
    folder = cache / "recordings" / f"{recording.scene}-{recording.seed}-{key}"
    if not is_recorded(folder, settings):
        record(build(recording.scene, settings), settings, folder, overwrite=True)
    return folder
