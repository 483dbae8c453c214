"""`driftyard gate update`: a new baseline."""

from dataclasses import dataclass
from typing import ClassVar

from trials.cli import console
from trials.cli.gate_check import BaselineOptions
from trials.cli.options import AnyEstimatorOptions, Distance, Disturb, changes, option
from trials.execution.recording_settings import parse_scenes
from trials.gate.baseline import write_baseline
from trials.gate.comparison import make_baseline
from trials.gate.design import Design
from trials.gate.rules import Rules
from trials.gate.statistics import MIN_DEGREES, degrees_of_freedom
from vo.contract.settings import validated


@dataclass(frozen=True)
class DesignOptions:
    """The sequences of a baseline."""

    PANEL: ClassVar[str] = "Sequences"
    scenes: str = option("", "Scenes to drive through, or all; required.", metavar="A,B,C")
    seeds: int = option(2, "Number of sequences of each scene.", min=1)
    first_seed: int = option(0, "Random seed of the first.", min=0)
    distance: Distance = 4.0
    disturb: Disturb = ""
    record: list[str] = changes("recording", "")

    @property
    def design(self) -> Design:
        """The sequences as the baseline stores them.

        Raises:
            SettingsError: If a scene is unknown.
        """
        content = {
            "scenes": parse_scenes(self.scenes),
            "seeds": self.seeds,
            "first_seed": self.first_seed,
            "disturb": self.disturb,
            "overrides": [f"drive.distance_m={self.distance:g}", *self.record],
        }
        return validated(Design, content)


@dataclass(frozen=True)
class RuleOptions:
    """The rules of the decision."""

    PANEL: ClassVar[str] = "Rules of the decision"
    reference: str = option(
        "corner_flow", "Estimator that frame times are divided by, so that machines compare."
    )
    level: float = option(0.05, "False alarm rate, and error rate of each confidence bound.")
    tolerance: float = option(
        0.005, "Regress if the lower bound of the relative increase of drift exceeds this."
    )
    margin: float = option(
        0.1, "Pass if the upper bound of the relative increase of drift is below."
    )
    time_margin: float = option(
        0.25, "The same for frame time, as tolerance and margin; 0 disables it."
    )
    nees_margin: float = option(0.5, "The same for the NEES of covariances; 0 disables it.")

    @property
    def rules(self) -> Rules:
        """The rules as the baseline stores them.

        Raises:
            SettingsError: If a value is not accepted.
        """
        content = {
            "level": self.level,
            "drift_tolerance": self.tolerance,
            "drift_margin": self.margin,
            "time_margin": self.time_margin,
            "nees_margin": self.nees_margin,
        }
        return validated(Rules, content)


def gate_update(
    baseline: BaselineOptions,
    estimator: AnyEstimatorOptions,
    design: DesignOptions,
    rules: RuleOptions,
) -> None:
    """Run an estimator over many sequences and write its results as the baseline."""
    path, bar = baseline.baseline, console.counting_bar
    choice, sequences, limits = estimator.choice, design.design, rules.rules
    made = make_baseline(choice, rules.reference, limits, sequences, baseline.cache, bar)
    write_baseline(path, made)
    lost = sum(x.is_lost for x in made.measured)
    console.out.print(
        f"{path}: {made.estimator} on {len(made.sequences)} sequences, {lost} of them lost",
        markup=False,
    )
    if degrees_of_freedom(made.scenes) < MIN_DEGREES:
        console.err.print(f"{path}: too few sequences to decide anything; see docs/gate.md")
