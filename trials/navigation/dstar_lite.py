"""D* Lite (Koenig and Likhachev 2002, optimised version) on any graph.

It searches from the goal, so that what it knows stays valid while the agent moves; when costs
change, it repairs only what they alter on the way to the agent. Line numbers in curly brackets
are those of the paper's figure 4.
"""

from collections.abc import Iterable
from heapq import heappop, heappush
from itertools import count
from math import inf
from typing import Generic

from trials.navigation.graph import Graph, N, edge_cost

SLACK = 1 + 1e-9
"""Keys this close count as equal: rounding must not end the search before a raised node is seen."""

Key = tuple[float, float]


class DStarLite(Generic[N]):
    """The cheapest path from a moving agent to a goal, kept up to date.

    Attributes:
        graph: The costs; whoever changes them says so to `replan`.
        start: Where the agent is.
        goal: Where it goes.
        expanded: Nodes expanded so far.

    Raises:
        PlanningError: If a cost on the way is NaN, zero or negative.
    """

    def __init__(self, graph: Graph[N], start: N, goal: N) -> None:
        self.graph, self.start, self.goal = graph, start, goal
        self.expanded = 0
        self._last = start
        self._km = 0.0
        self._g: dict[N, float] = {}
        self._rhs: dict[N, float] = {goal: 0.0}
        self._queue: list[tuple[Key, int, N]] = []
        self._queued: dict[N, Key] = {}  # an entry of the queue with another key is outdated
        self._entry = count()
        self._push(goal)
        self._search()

    @property
    def cost(self) -> float:
        """Of the path from start to goal; infinite if there is none."""
        return self._rhs.get(self.start, inf)

    def move(self, start: N) -> None:
        """Note where the agent is now."""
        self.start = start

    def replan(self, changed: Iterable[N] = ()) -> None:
        """Repair the path.

        Args:
            changed: Nodes of which outgoing edges changed their cost, appeared or vanished.

        Raises:
            PlanningError: If a cost on the way is NaN, zero or negative.
        """
        self._km += self.graph.heuristic(self._last, self.start)  # {38'}
        self._last = self.start
        for node in changed:  # {40'-45'}, all edges of a node at once
            self._look_ahead(node)
            self._update(node)
        self._search()

    def path(self) -> list[N]:
        """List the nodes from start to goal; none if there is no way."""
        if self.cost == inf:
            return []
        nodes = [self.start]
        while nodes[-1] != self.goal:
            nodes.append(self._best(nodes[-1])[1])
        return nodes

    def _key(self, node: N) -> Key:  # {1'}
        near = min(self._g.get(node, inf), self._rhs.get(node, inf))
        return near + self.graph.heuristic(self.start, node) + self._km, near

    def _push(self, node: N) -> None:
        key = self._key(node)
        if self._queued.get(node) != key:
            self._queued[node] = key
            heappush(self._queue, (key, next(self._entry), node))

    def _update(self, node: N) -> None:  # {7'-9'}
        if self._g.get(node, inf) != self._rhs.get(node, inf):
            self._push(node)
        else:
            self._queued.pop(node, None)

    def _top(self) -> tuple[Key, N] | None:
        while self._queue:
            key, _, node = self._queue[0]
            if self._queued.get(node) == key:
                return key, node
            heappop(self._queue)
        return None

    def _best(self, node: N) -> tuple[float, N]:
        """Cost to the goal through the best successor, and that successor."""
        best, through = inf, node
        for successor in self.graph.successors(node):
            cost = edge_cost(self.graph, node, successor) + self._g.get(successor, inf)
            if cost < best:
                best, through = cost, successor
        return best, through

    def _look_ahead(self, node: N) -> None:
        if node != self.goal:
            self._rhs[node] = self._best(node)[0]

    def _search(self) -> None:  # {10'-28'}
        while (top := self._top()) is not None:
            old_key, node = top
            if old_key[0] > self._key(self.start)[0] * SLACK and self.cost <= self._g.get(
                self.start, inf
            ):
                return
            key = self._key(node)
            if old_key < key:  # {14'}: the agent has moved since
                self._push(node)
                continue
            self.expanded += 1
            del self._queued[node]
            g_old, g = self._g.get(node, inf), self._rhs.get(node, inf)
            if g_old > g:  # {16'-20'}: closer to the goal than known
                self._g[node] = g
                for source in self.graph.predecessors(node):
                    cost = edge_cost(self.graph, source, node) + g
                    if source != self.goal and cost < self._rhs.get(source, inf):
                        self._rhs[source] = cost
                        self._update(source)
            else:  # {21'-28'}: farther; whoever relied on it looks for another way
                self._g[node] = inf
                self._update(node)
                for source in self.graph.predecessors(node):
                    cost = edge_cost(self.graph, source, node) + g_old
                    if self._rhs.get(source, inf) == cost:
                        self._look_ahead(source)
                        self._update(source)
