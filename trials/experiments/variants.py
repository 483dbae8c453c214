"""Variants that several experiments compare."""

from trials.experiments.trial import Variant

THESIS = Variant("thesis", "thesis")
UNREFINED = Variant("thesis without refinement", "thesis", ("refinement.mode=none",))
DEFAULT = Variant("default", "driftyard")
