"""The regression gate: has an estimator become worse than its baseline?"""

import json
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from driftyard.dataset import PathLike
from driftyard.estimation import AnyEstimator, choice_of
from driftyard.failures import in_one_family
from driftyard.given_settings import GivenSettings
from trials.evaluation.display import html_display
from trials.execution.cache import CACHE
from trials.execution.progress import counted, no_progress
from trials.gate.comparison import Comparison, compare
from trials.gate.decision import Verdict
from trials.gate.reports import HEADER, as_json, headline, rows


@dataclass(frozen=True, repr=False)
class GateResult:
    """Verdict on an estimator, and the figures that it follows from.

    Attributes:
        comparison: Baseline, measurements and statistics.

    Example:
        >>> result = dy.gate("gate.json", "corner_flow", accept=("datasets", "platform"))
        >>> result.verdict in ("pass", "regress", "undecided")
        True
    """

    comparison: Comparison

    @property
    def verdict(self) -> Verdict:
        """`pass`, `regress` or `undecided`, a string."""
        return self.comparison.decision.verdict

    @property
    def headline(self) -> str:
        """The verdict and its reason in one line."""
        return headline(self.comparison)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures, beside those of the baseline, ready for JSON."""
        return json.loads(as_json(self.comparison))

    def __repr__(self) -> str:
        return f"GateResult({self.headline!r})"

    def _repr_html_(self) -> str:
        return html_display(self.headline, [HEADER, *rows(self.comparison)])


@in_one_family
def gate(
    baseline: PathLike,
    estimator: AnyEstimator = "driftyard",
    *,
    settings: GivenSettings = None,
    accept: Collection[str] = (),
    cache: PathLike = CACHE,
) -> GateResult:
    """Decide whether an estimator drifts more than a baseline over the same sequences.

    The sequences are recorded if the cache does not have them.

    Args:
        baseline: JSON file that `driftyard gate update` wrote.
        estimator: As for `run`.
        settings: As for `run`.
        accept: Differences from the baseline to accept: `datasets`, `platform`.
        cache: Folder of recordings.

    Raises:
        DriftyardError: If the baseline is invalid, sequences or platform differ from it, or the
            estimator is wrong or fails on every sequence.

    Example:
        >>> dy.gate("gate.json", "corner_flow", accept=["datasets", "platform"]).headline
        'undecided: corner_flow against corner_flow: too few sequences for a decision: 1 of 1 \
scenes; five scenes are enough, or five seeds of one'
    """
    choice = choice_of(estimator, settings)
    bar = partial(counted, no_progress)
    return GateResult(compare(Path(baseline), choice, accept, Path(cache), bar))
