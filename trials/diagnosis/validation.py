"""Validation of the attribution by injected errors: `driftyard explain --validate`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from trials.diagnosis.attribution import Attribution, attribute
from trials.diagnosis.combinations import Subject, combinations_of, paired, run_all
from trials.diagnosis.error_injection import InjectedError

CASES = {
    "1 px noise on matches": (InjectedError(pixel_sigma_px=1.0), "matching"),
    "baseline 1 % too long": (InjectedError(baseline_percent=1.0), "stereo"),
    "disparities 0.5 px too large": (InjectedError(disparity_bias_px=0.5), "stereo"),
}
"""Description to the injected error and the stage in which it is."""
MIN_ATTRIBUTED = 0.8
"""Smallest ratio of the added drift that must be attributed to that stage."""


@dataclass(frozen=True)
class Finding:
    """Attribution before and after the error of a case is injected into a stage."""

    name: str
    stage: str
    before: Attribution
    after: Attribution

    @property
    def attributed(self) -> float:
        """Ratio of the added drift that is attributed to the stage with the error."""
        was, now = (
            next(x.drift.value for x in attribution.shares if x.stage == self.stage)
            for attribution in (self.before, self.after)
        )
        return (now - was) / (self.after.drift.value - self.before.drift.value)


def validate(
    datasets: Sequence[Path], subject: Subject, stages: Sequence[str], cache: Path,
    progress: Callable[[int, int], None],
) -> list[Finding]:  # fmt: skip
    """Attribute the drift with and without each injected error.

    Args:
        datasets: With depth labels.
        subject: Without an injected error.
        stages: Among them `matching` and `stereo`.
        cache: Folder of the cache.
        progress: Called with the number of finished runs and of all runs.
    """
    subjects = [subject, *(replace(subject, error=x) for x, _ in CASES.values())]
    jobs = {(s, d): combinations_of(d, s, stages, cache) for s in subjects for d in datasets}
    every = [job for some in jobs.values() for job in some.values()]
    found = run_all(every, lambda done: progress(done, len(every)))
    before, *after = (
        attribute(
            [paired(str(d), {c: found[x] for c, x in jobs[s, d].items()}) for d in datasets], stages
        )
        for s in subjects
    )
    return [
        Finding(name, stage, before, with_error)
        for (name, (_, stage)), with_error in zip(CASES.items(), after, strict=True)
    ]
