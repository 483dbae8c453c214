"""Variants that several experiments compare."""

from trials.execution.jobs import Variant

THESIS = Variant("thesis", "thesis")
UNREFINED = Variant("thesis without refinement", "thesis", ("refinement.mode=none",))
DEFAULT = Variant("default", "driftyard")
