"""Whether attribution finds what was done wrong on purpose; `driftyard explain --validate`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.table import Table

from trials.diagnosis.attribution import Attribution, attribute
from trials.diagnosis.combinations import Drift, Job, Subject, drifts, jobs_for, paired, run_folder
from trials.diagnosis.error_injection import Injection

CASES = {
    "1 px noise on matches": (Injection(pixel_sigma_px=1.0), "matching"),
    "baseline 1 % too long": (Injection(baseline_percent=1.0), "stereo"),
    "disparities 0.5 px too large": (Injection(disparity_bias_px=0.5), "stereo"),
}
"""What is done wrong, and who is to blame."""
LEAST = 0.8


@dataclass(frozen=True)
class Finding:
    """Where the drift that an injected error added was put.

    Attributes:
        name: Of the case.
        culprit: Stage in which the error is.
        before: Attribution without it.
        after: And with it.
    """

    name: str
    culprit: str
    before: Attribution
    after: Attribution

    @property
    def blamed(self) -> float:
        """Share of the added drift that the culprit is blamed for."""
        was, now = (
            next(x.drift for x in attribution.shares if x.stage == self.culprit)
            for attribution in (self.before, self.after)
        )
        return (now - was) / (self.after.drift - self.before.drift)


def validate(
    datasets: Sequence[Path], subject: Subject, players: Sequence[str], cache: Path,
    progress: Callable[[int, int], None],
) -> list[Finding]:  # fmt: skip
    """Explain datasets with and without each injected error.

    Args:
        datasets: With depth labels.
        subject: Without an injection.
        players: Among them `matching` and `stereo`.
        cache: Runs are kept here.
        progress: Called with the runs done and those in all.
    """
    subjects = [subject, *(replace(subject, injection=x) for x, _ in CASES.values())]
    jobs = {
        (s, d): jobs_for(d, s, players, run_folder(d, s, cache)) for s in subjects for d in datasets
    }
    every = [job for some in jobs.values() for job in some.values()]
    found: dict[Job, Drift] = {}
    for done, (job, drift) in enumerate(drifts(every), 1):
        found[job] = drift
        progress(done, len(every))
    before, *after = (
        attribute(
            [
                paired(str(d), {c: found[job] for c, job in jobs[subject, d].items()})
                for d in datasets
            ],
            players,
        )
        for subject in subjects
    )
    return [
        Finding(name, culprit, before, with_error)
        for (name, (_, culprit)), with_error in zip(CASES.items(), after, strict=True)
    ]


def validation_table(
    datasets: Sequence[Path], subject: Subject, players: Sequence[str], cache: Path,
    progress: Callable[[int, int], None],
) -> Table:  # fmt: skip
    """Lay out who is blamed for each injected error."""
    table = Table("injected", "drift, %", "with it", "in", "blamed for", f"≥ {LEAST:.0%}")
    for x in validate(datasets, subject, players, cache, progress):
        ok = "yes" if x.blamed >= LEAST else "NO"
        drifts_percent = (f"{a.drift:.3f}" for a in (x.before, x.after))
        table.add_row(x.name, *drifts_percent, x.culprit, f"{x.blamed:.0%}", ok)
    return table
