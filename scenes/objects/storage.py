"""Warehouse equipment: pallets and their loads, racks, drums, trucks and cones."""

import numpy as np

from scenes.geometry.mesh import Mesh, box, merged, tube
from scenes.pen import Pen, Place, local, piece
from scenes.stage import Stage
from vo.contract.arrays import Array

PALLET_M = (1.2, 0.8, 0.144)
BAY_M = 2.5
RACK_DEPTH_M = 1.1
LEVELS_M = (0.0, 1.4, 2.75)
RACK_HEIGHT_M = 3.6


def pallet(rng: np.random.Generator) -> Mesh:
    """Build a pallet of 1.2 x 0.8 m on z = 0: seven boards on nine blocks on three runners."""
    grain = (1.0, 0.25)
    rows = np.linspace(-0.35, 0.35, 7)
    parts = [box((0, y, 0.133), (1.2, 0.1, 0.022), grain, rng.random(2), 2.0, True) for y in rows]
    for x in (-0.53, 0.0, 0.53):
        parts.append(box((x, 0, 0.111), (0.1, 0.8, 0.022), grain, rng.random(2), 2.0, True))
        parts.append(box((x, 0, 0.011), (0.1, 0.8, 0.022), grain, rng.random(2), 2.0))
        for y in (-0.33, 0.0, 0.33):
            parts.append(box((x, y, 0.061), (0.1, 0.14, 0.078), grain, rng.random(2), 2.0))
    return merged(parts)


def _cartons(stage: Stage, rng: np.random.Generator, place: Place, base: float) -> float:
    """Stack equal cartons on a pallet; returns the height of the top."""
    rect = stage.pick("cartons", rng)
    across, deep = ((3, 2), (2, 2), (4, 3))[rng.integers(3)]
    high = float(rng.uniform(0.22, 0.36))
    layers = max(1, int(rng.uniform(0.5, 0.95) / high))
    size = np.array([1.14 / across, 0.76 / deep, high])
    pieces: list[Mesh] = []
    for layer in range(layers):
        left_out = rng.integers(across * deep) if layer == layers - 1 else -1
        for k in range(across * deep):
            if k == left_out:
                continue
            i, j = k % across, k // across
            x, y = (i - (across - 1) / 2) * size[0], (j - (deep - 1) / 2) * size[1]
            shift = rng.normal(0, 0.006, 2)
            centre = (x + shift[0], y + shift[1], base + (layer + 0.5) * high)
            pieces.append(box(centre, size - 0.006, cell_m=2.0).textured(rect))
    Pen(stage, place)("cartons", merged(pieces))
    return base + layers * high


def _drums(stage: Stage, rng: np.random.Generator, place: Place, base: float) -> float:
    """Stand three or four drums on a pallet; returns the height of the top."""
    rect = stage.pick("drums", rng)
    put = Pen(stage, place)
    for x, y in ((-0.31, -0.01), (0.31, -0.01))[: rng.integers(1, 3)]:
        put("drums", drum(rng, (x, y, base)).textured(rect))
    return base + 0.88


def drum(rng: np.random.Generator, foot: tuple[float, float, float]) -> Mesh:
    """Build a steel drum, 0.58 m wide and 0.88 m high, turned at random."""
    x, y, z = foot
    body = tube((0, 0, 0), (0, 0, 0.88), 0.285, 20)
    hoops = [tube((0, 0, h), (0, 0, h + 0.022), 0.293, 20) for h in (0.0, 0.28, 0.58, 0.858)]
    return merged([body, *hoops]).moved((x, y, z), rng.uniform(0, 2 * np.pi))


def _crate(stage: Stage, rng: np.random.Generator, place: Place, base: float) -> float:
    """Build a slatted crate on a pallet; returns the height of the top."""
    high = float(rng.uniform(0.5, 0.8))
    put = Pen(stage, place)
    grain = (1.0, 0.25)
    put("pine", box((0, 0, base + high / 2), (1.06, 0.66, high), (1.0, 0.3), rng.random(2), 2.0))
    for z in np.arange(0.07, high, 0.15):
        for y in (-0.345, 0.345):
            put("pine", box((0, y, base + z), (1.12, 0.025, 0.1), grain, rng.random(2), 2.0, True))
    for x in (-0.53, 0.53):
        for y in (-0.36, 0.36):
            centre, size = (x, y, base + high / 2), (0.07, 0.03, high + 0.02)
            put("pine", box(centre, size, grain, rng.random(2), 2.0))
    return base + high


def load(stage: Stage, rng: np.random.Generator, place: Place, base: float) -> None:
    """Put a loaded pallet, or a stack of empty ones, at a place on a shelf `base` metres up."""
    kind = rng.choice(["cartons", "drums", "crate", "empty"], p=[0.6, 0.18, 0.12, 0.1])
    stack = int(rng.integers(2, 6)) if kind == "empty" else 1
    for k in range(stack):
        turn = local(place, 0.0, 0.0, float(rng.normal(0, 0.012)))
        stage.draw("pine", pallet(rng).moved((turn[0], turn[1], base + k * PALLET_M[2]), turn[2]))
    floor = base + stack * PALLET_M[2]
    build = {"cartons": _cartons, "drums": _drums, "crate": _crate}.get(str(kind))
    top = build(stage, rng, place, floor) if build else floor
    Pen(stage, place).shade((base + top) / 2, (1.2, 0.8, top - base), 0.92)


@piece
def rack(put: Pen, rng: np.random.Generator, bays: int) -> None:
    """Put up a pallet rack of `bays` bays along x, without its load."""
    length = bays * BAY_M
    for x in np.linspace(-length / 2, length / 2, bays + 1):
        for y in (-0.48, 0.48):
            post = box((x, y, RACK_HEIGHT_M / 2), (0.09, 0.07, RACK_HEIGHT_M), (0.25, 1.0), (0, 0))
            put("post", post)
            put("steel", box((x, y, 0.005), (0.15, 0.12, 0.01), (0.5, 0.5), rng.random(2)))
        for z in np.arange(0.2, RACK_HEIGHT_M - 0.5, 0.6):
            sign = 1 if round(z / 0.6) % 2 else -1
            put("steel", tube((x, -0.46 * sign, z), (x, 0.46 * sign, z + 0.6), 0.018, 5))
        for y in (-0.58, 0.58):
            put("hazard", box((x, y, 0.2), (0.13, 0.05, 0.4), (0.4, 0.4), rng.random(2), 0.2))
    for z in LEVELS_M[1:]:
        for k in range(bays):
            middle = -length / 2 + (k + 0.5) * BAY_M
            for y in (-0.48, 0.48):
                put("beam", box((middle, y, z - 0.06), (BAY_M - 0.09, 0.05, 0.12), (1.0, 1.0)))
                for x in (-0.6, 0.6):
                    put("tags", box((middle + x, y * 1.055, z - 0.06), (0.16, 0.003, 0.07)))
    put.solid((length + 0.14, RACK_DEPTH_M + 0.1, RACK_HEIGHT_M), shadow=False)


@piece
def pallet_truck(put: Pen, rng: np.random.Generator) -> None:
    """Park a hand pallet truck, its forks towards -y before the turn."""
    for x in (-0.19, 0.19):
        put("red", box((x, -0.45, 0.075), (0.16, 1.15, 0.05), (0.5, 0.5), rng.random(2), 0.3, True))
        put("dark", tube((x - 0.05, -0.9, 0.04), (x + 0.05, -0.9, 0.04), 0.04, 10))
    put("red", box((0, 0.16, 0.22), (0.5, 0.12, 0.34), (0.5, 0.5), rng.random(2), 0.2, True))
    put("red", tube((0, 0.2, 0.3), (0, 0.2, 0.55), 0.07, 12, 0.8))
    put("dark", tube((-0.07, 0.24, 0.09), (0.07, 0.24, 0.09), 0.09, 14))
    put("red", tube((0, 0.22, 0.5), (0, 0.5, 1.15), 0.018, 8))
    put("dark", tube((-0.16, 0.5, 1.15), (0.16, 0.5, 1.15), 0.02, 8))
    put.solid((0.56, 1.6, 1.1), (0.0, -0.3), shadow=False)
    put.shade(0.1, (0.52, 1.3, 0.12), 0.9, (0.0, -0.3))


@piece
def cone(put: Pen) -> None:
    """Put a traffic cone, 0.5 m high, with a white band."""
    put("cone", box((0, 0, 0.015), (0.3, 0.3, 0.03)))
    put("cone", tube((0, 0, 0.03), (0, 0, 0.2), 0.12, 16, 0.72))
    put("band", tube((0, 0, 0.2), (0, 0, 0.32), 0.0864, 16, 0.72))
    put("cone", tube((0, 0, 0.32), (0, 0, 0.5), 0.0622, 16, 0.4))
    put.solid((0.3, 0.3, 0.5), shadow=False)
    put.shade(0.12, (0.2, 0.2, 0.24), 0.8)


def standing_drums(stage: Stage, name: str, rng: np.random.Generator, centre: Array) -> None:
    """Stand two to four drums in a cluster at (2,) metres, each an object of its own."""
    for k in range(int(rng.integers(2, 5))):
        x, y = centre + np.array([(k % 2) * 0.62 - 0.31, (k // 2) * 0.62 - 0.31])
        with stage.object(f"{name}_{k}"):
            stage.draw("drums", drum(rng, (x, y, 0.0)).textured(stage.pick("drums", rng)))
        stage.obstacle(f"{name}_{k}", (x, y, 0.44), (0.52, 0.52, 0.88))
