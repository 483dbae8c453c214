"""What a planner asks of a graph, and what it refuses."""

from collections.abc import Hashable, Iterable
from typing import Protocol, TypeVar

from vo.contract.errors import DriftyardError

N = TypeVar("N", bound=Hashable)


class PlanningError(DriftyardError):
    """A cost that is no cost, or a start or goal outside the graph."""


class Graph(Protocol[N]):
    """A directed graph with positive costs; an infinite cost is a way that is closed.

    `heuristic` never exceeds the cheapest cost between two nodes, and obeys the triangle
    inequality: h(a, c) <= h(a, b) + h(b, c). Zero everywhere is always right.
    """

    def successors(self, node: N, /) -> Iterable[N]:
        """Nodes that can be entered from `node`."""
        ...

    def predecessors(self, node: N, /) -> Iterable[N]:
        """Nodes from which `node` can be entered."""
        ...

    def cost(self, a: N, b: N, /) -> float:
        """Of the edge from `a` to its successor `b`: positive or infinite."""
        ...

    def heuristic(self, a: N, b: N, /) -> float:
        """Lower bound of the cost from `a` to `b`."""
        ...


def edge_cost(graph: Graph[N], a: N, b: N) -> float:
    """Look up the cost of an edge.

    Raises:
        PlanningError: If it is NaN, zero or negative.
    """
    cost = graph.cost(a, b)
    if not cost > 0:
        raise PlanningError(f"edge {a} to {b}: cost {cost} is not positive")
    return cost
