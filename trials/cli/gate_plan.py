"""`driftyard gate plan`: how many sequences a wanted sensitivity needs."""

from math import inf, log1p

from trials.cli import console
from trials.cli.gate_check import ComparisonOptions
from trials.cli.options import AnyEstimatorOptions, argument
from trials.gate.tables import plan_line
from vo.contract.errors import SettingsError


def gate_plan(
    baseline: ComparisonOptions,
    estimator: AnyEstimatorOptions,
    change: str = argument(..., "Increase of drift to find, such as 5%.", metavar="PERCENT"),
) -> None:
    """Compute how many scenes or seeds it takes to find an increase of drift.

    The estimator runs over the sequences of the baseline; the answer follows from how much the
    differences vary between and within scenes.
    """
    wanted = parse_change(change)
    console.out.print(plan_line(baseline.compare(estimator), wanted), markup=False)


def parse_change(text: str) -> float:
    """Parse `5%` or `5` to the logarithm of a ratio.

    Raises:
        SettingsError: If it is no number from 0.1 to 1000.
    """
    try:
        percent = float(text.strip().removesuffix("%"))
    except ValueError:
        percent = -inf
    if not 0.1 <= percent <= 1000:
        raise SettingsError(f"PERCENT {text}: expected a change from 0.1 % to 1000 %, such as 5%")
    return log1p(percent / 100)
