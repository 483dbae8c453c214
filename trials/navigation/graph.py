"""The interface of a directed graph of numbered nodes for the compiled planners.

A graph is a `Grid` or an `Adjacency`. Each function below calls that of the kind of graph, so that
a planner stands once and numba compiles it for each kind. Costs are positive; an infinite cost
closes an edge.
"""

from collections.abc import Callable, Mapping
from typing import Any

from numba import njit
from numba.extending import overload

from trials.navigation import adjacency, grid
from trials.navigation.adjacency import Adjacency
from trials.navigation.grid import Grid

Graph = Grid | Adjacency


def _by_kind(kinds: Mapping[type, Callable[..., Any]]) -> Callable[..., Any]:
    """Make a function that compiled code resolves by the kind of its first argument, a graph.

    The functions should index the graph's arrays themselves: handing them on to another function
    costs a third of a planner's speed, for numba then counts references in the innermost loop.
    """

    def interface(graph: Graph, *_: int) -> Any:
        raise NotImplementedError  # pragma: no cover, callable from compiled code alone

    def choose(*types: Any) -> Callable[..., Any] | None:
        return kinds.get(getattr(types[0], "instance_class", object))

    overload(interface, strict=False)(choose)
    vars(interface)["implementations"] = [njit(x) for x in kinds.values()]
    return interface


out_degree = _by_kind({Grid: grid.degree, Adjacency: adjacency.out_degree})
"""Number of edges that leave a node: (graph, node)."""
in_degree = _by_kind({Grid: grid.degree, Adjacency: adjacency.in_degree})
"""Number of edges that enter a node: (graph, node)."""
successor = _by_kind({Grid: grid.step, Adjacency: adjacency.successor})
"""Node that the k-th outgoing edge of a node enters, and cost of the edge: (graph, node, k)."""
predecessor = _by_kind({Grid: grid.step, Adjacency: adjacency.predecessor})
"""Node that the k-th incoming edge of a node leaves, and cost of the edge: (graph, node, k)."""
heuristic = _by_kind({Grid: grid.octile, Adjacency: adjacency.bound})
"""Lower bound of the cost from a to b, with h(a, c) <= h(a, b) + h(b, c): (graph, a, b)."""
