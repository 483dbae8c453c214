"""Museum exhibits: framed paintings, sculptures on pedestals, rope barriers and benches."""

import itertools

import numpy as np

from scenes.geometry.mesh import Mesh, box, merged, tube
from scenes.objects.props import ball
from scenes.pen import Pen, piece

CENTRE_M = 1.4
"""Height of the middle of a painting."""
FRAME_M = 0.05


@piece
def painting(put: Pen, rng: np.random.Generator, along_m: float) -> None:
    """Hang a framed painting on a wall, its label beside it."""
    wide, high = rng.uniform((0.7, 0.55), (1.5, 1.1))
    frame = ("frame_gold", "frame_black")[rng.integers(2)]
    for dx, dz, sx, sz in (
        (0, high / 2, wide + 2 * FRAME_M, FRAME_M),
        (0, -high / 2, wide + 2 * FRAME_M, FRAME_M),
        (wide / 2 + FRAME_M / 2, 0, FRAME_M, high),
        (-wide / 2 - FRAME_M / 2, 0, FRAME_M, high),
    ):
        bar = box((along_m + dx, -0.025, CENTRE_M + dz), (sx, 0.05, sz), (0.4, 0.4), bottom=True)
        put(frame, bar)
    put.cell("paintings", rng, box((along_m, -0.012, CENTRE_M), (wide, 0.02, high)))
    put("labels", box((along_m + wide / 2 + 0.22, -0.003, CENTRE_M - 0.25), (0.14, 0.006, 0.1)))


@piece
def sculpture(put: Pen, rng: np.random.Generator) -> None:
    """Show a sculpture of bronze or marble on a pedestal of 0.5 x 0.5 x 0.8 m."""
    put("pedestal", box((0, 0, 0.4), (0.5, 0.5, 0.8), (1.0, 1.0), rng.random(2)))
    put("frame_black", box((0, 0, 0.02), (0.46, 0.46, 0.04), (0.4, 0.4)))
    put("labels", box((0, -0.252, 0.6), (0.12, 0.004, 0.08)))
    stuff = ("bronze", "marble")[rng.integers(2)]
    put(stuff, _SHAPES[rng.integers(len(_SHAPES))](rng).moved((0, 0, 0.8)))
    put.solid((0.5, 0.5, 1.3), shadow=False)
    put.shade(0.4, (0.48, 0.48, 0.8))
    put.shade(1.05, (0.3, 0.3, 0.5), 0.8)


def _torso(rng: np.random.Generator) -> Mesh:
    lean = rng.normal(0, 0.02, 2)
    neck = (lean[0], lean[1], 0.34)
    return merged(
        [
            box((0, 0, 0.02), (0.3, 0.3, 0.04), (0.6, 0.6)),
            tube((0, 0, 0.04), neck, 0.15, 12, 0.45),
            ball(rng, (0, 0, 0.2), 0.15),
            ball(rng, (lean[0], lean[1], 0.44), 0.11),
        ]
    )


def _pile(rng: np.random.Generator) -> Mesh:
    """Stack blocks of shrinking size, each turned."""
    parts: list[Mesh] = []
    base = 0.0
    for side in (0.34, 0.26, 0.2, 0.14):
        block = box((0, 0, 0), (side, side, 0.7 * side), (0.6, 0.6), rng.random(2), bottom=True)
        parts.append(block.moved((*rng.normal(0, 0.02, 2), base + 0.35 * side), rng.uniform(0, 3)))
        base += 0.7 * side
    return merged(parts)


def _knot(rng: np.random.Generator) -> Mesh:
    """Build a closed bar that winds around itself."""
    phase = rng.uniform(0, 2 * np.pi)
    t = np.linspace(0, 2 * np.pi, 37)
    reach = 0.13 + 0.05 * np.cos(3 * t + phase)
    rise = 0.3 + 0.16 * np.sin(3 * t + phase)
    spine = np.column_stack([reach * np.cos(2 * t), reach * np.sin(2 * t), rise])
    rods = [tube(a, b, 0.035, 8) for a, b in itertools.pairwise(spine)]
    return merged([*rods, tube((0, 0, 0), (0, 0, 0.2), 0.05, 10)])


_SHAPES = (_torso, _pile, _knot)


@piece
def barrier(put: Pen, length_m: float) -> None:
    """Put brass posts about 1.2 m apart along x from a place, with a sagging rope."""
    marks = np.linspace(0, length_m, max(2, round(length_m / 1.2) + 1))
    for x in marks:
        put("brass", tube((x, 0, 0), (x, 0, 0.02), 0.14, 16))
        put("brass", tube((x, 0, 0.02), (x, 0, 0.9), 0.018, 8))
        put("brass", tube((x, 0, 0.9), (x, 0, 0.95), 0.03, 10, 0.6))
    for start, end in itertools.pairwise(marks):
        share = np.linspace(0, 1, 9)
        sag = 0.85 - 0.9 * share * (1 - share)
        rope = np.column_stack([start + share * (end - start), 0 * share, sag])
        for a, b in itertools.pairwise(rope):
            put("rope", tube(a, b, 0.016, 6))
    put.solid((length_m + 0.28, 0.28, 0.95), (length_m / 2, 0.0), shadow=False)


@piece
def settee(put: Pen, rng: np.random.Generator) -> None:
    """Put an upholstered bench of 1.5 x 0.55 m without a back."""
    put("cloth", box((0, 0, 0.4), (1.5, 0.55, 0.1), (0.4, 0.4), rng.random(2), 0.3, True))
    put("frame_black", box((0, 0, 0.33), (1.4, 0.48, 0.04), (0.4, 0.4), bottom=True))
    for x in (-0.62, 0.62):
        for y in (-0.2, 0.2):
            put("brass", box((x, y, 0.16), (0.04, 0.04, 0.32), (0.4, 0.4)))
    put.solid((1.5, 0.55, 0.45), shadow=False)
    put.shade(0.4, (1.5, 0.55, 0.1))
