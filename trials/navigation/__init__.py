"""Path planning, mapping and control of the rover."""

from vo.contract.errors import DriftyardError


class PlanningError(DriftyardError):
    """A cost that is not positive, or a start or goal outside the graph or without a path."""
