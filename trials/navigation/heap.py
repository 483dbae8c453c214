"""A binary heap of numbered nodes by two-part keys that can be changed, compiled."""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled


class Heap(NamedTuple):
    """Arrays of the heap.

    Attributes:
        keys: (n, 2) by node; compared in the order of the columns.
        nodes: (n,) int64, the heap: the node at each place.
        places: (n,) int64, the place of each node; -1 if it is not in the heap.
        size: (1,) int64, places in use.
    """

    keys: Array
    nodes: Array
    places: Array
    size: Array


def empty_heap(nodes: int) -> Heap:
    """Make a heap for nodes 0 ... nodes - 1 with none in it."""
    places = np.full(nodes, -1, dtype=np.int64)
    return Heap(np.empty((nodes, 2)), np.empty(nodes, np.int64), places, np.zeros(1, np.int64))


@compiled()
def put(heap: Heap, node: int, first: float, second: float) -> None:
    """Insert a node, or change its key."""
    heap.keys[node, 0], heap.keys[node, 1] = first, second
    if heap.places[node] < 0:
        heap.places[node] = heap.size[0]
        heap.nodes[heap.size[0]] = node
        heap.size[0] += 1
    _rise(heap, int(heap.places[node]))
    _sink(heap, int(heap.places[node]))


@compiled()
def remove(heap: Heap, node: int) -> None:
    """Take a node out; nothing happens if it is not in."""
    place = int(heap.places[node])
    if place < 0:
        return
    heap.size[0] -= 1
    last = heap.nodes[heap.size[0]]
    heap.places[node] = -1
    if last != node:
        heap.nodes[place] = last
        heap.places[last] = place
        _rise(heap, place)
        _sink(heap, int(heap.places[last]))


@compiled()
def _before(heap: Heap, a: int, b: int) -> bool:
    if heap.keys[a, 0] != heap.keys[b, 0]:
        return heap.keys[a, 0] < heap.keys[b, 0]
    return heap.keys[a, 1] < heap.keys[b, 1]


@compiled()
def _rise(heap: Heap, place: int) -> None:
    while place > 0:
        above = (place - 1) // 2
        if not _before(heap, heap.nodes[place], heap.nodes[above]):
            return
        _swap(heap, place, above)
        place = above


@compiled()
def _sink(heap: Heap, place: int) -> None:
    while True:
        least = place
        for below in (2 * place + 1, 2 * place + 2):
            if below < heap.size[0] and _before(heap, heap.nodes[below], heap.nodes[least]):
                least = below
        if least == place:
            return
        _swap(heap, place, least)
        place = least


@compiled()
def _swap(heap: Heap, a: int, b: int) -> None:
    heap.nodes[a], heap.nodes[b] = heap.nodes[b], heap.nodes[a]
    heap.places[heap.nodes[a]], heap.places[heap.nodes[b]] = a, b
