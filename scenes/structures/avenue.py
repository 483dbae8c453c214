"""An avenue along x: lanes either side of a green strip, bays, kerbs, pavements and plots."""

from dataclasses import dataclass

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, boxes, merged, patch
from scenes.objects.plants import grass
from scenes.objects.props import litter
from scenes.scene import Kind
from scenes.stage import Stage
from scenes.structures.ground import level, quads, scattered, tiled
from scenes.structures.paths import BlockGround
from scenes.surfaces.atlas import Atlas
from vo.contract.arrays import Array

STRIP_M, LANE_M, BAY_M, PAVED_M, PLOT_M = 2.0, 5.2, 7.3, 9.6, 45.0
"""From the middle: where the green strip, the lane, the parking bays, the pavement and the land
end."""
KERB_M = (0.15, 0.11)
"""Width of kerbs, and their height."""
VERGE_M, PAVEMENT_M = 0.07, 0.09
"""Heights of the green strip and of pavements."""
MARK_M = 0.0006
"""Height of patches; that of cracks and paint is a multiple."""
TILE_M = 0.5


@dataclass(frozen=True)
class Avenue:
    """Where an avenue runs, metres along x.

    Attributes:
        ends: Of the road.
        turns: (2, 2) both ends of each gap in the green strip, where one turns round.
        driven: Ends of the part that is laid finely.
    """

    ends: tuple[float, float]
    turns: Array
    driven: tuple[float, float]

    @property
    def strips(self) -> list[tuple[float, float]]:
        """Both ends of each piece of the green strip."""
        cuts = [self.ends[0], *self.turns.ravel(), self.ends[1]]
        return list(zip(cuts[::2], cuts[1::2], strict=True))


def lay(ground: BlockGround, rng: np.random.Generator, avenue: Avenue, wear: float) -> None:
    """Lay an avenue; `wear` is the share of the asphalt's places that are mended or cracked."""
    stage = ground.stage
    with stage.object("road", Kind.GROUND):
        ground.draw("asphalt", _asphalt(rng, avenue))
        ground.draw("bays", _bays(rng, avenue))
    with stage.object("repairs", Kind.GROUND):
        _repair(ground, rng, avenue, wear)
    with stage.object("markings", Kind.GROUND):
        ground.draw("marking", _markings(rng, avenue))
    with stage.object("kerb"):
        ground.draw("concrete", _kerbs(stage, rng, avenue))
    with stage.object("pavement", Kind.GROUND):
        ground.draw("slabs", _pavements(rng, avenue, stage.atlases["slabs"]))
    with stage.object("green_strip", Kind.GROUND):
        for k, (start, end) in enumerate(avenue.strips):
            _green(ground, rng, k, start, end)
    with stage.object("land", Kind.GROUND):
        ground.draw("turf", _land(rng, avenue))


def _asphalt(rng: np.random.Generator, avenue: Avenue) -> Mesh:
    """Lay the lanes finely where one drives, and coarsely beyond and across the gaps."""
    (start, end), (first, last) = avenue.ends, avenue.driven
    fields: list[tuple[Vector, Vector, float]] = []
    for low, high in ((-LANE_M, -STRIP_M), (STRIP_M, LANE_M)):
        fields += [((first, low), (last, high), 0.25)]
        fields += [((a, low), (b, high), 0.5) for a, b in ((start, first), (last, end))]
    fields += [((a, -STRIP_M), (b, STRIP_M), 0.25) for a, b in avenue.turns]
    corners = np.concatenate([quads(*field) for field in fields])
    return level(corners, scattered(rng, corners, TILE_M, 1.024))


def _bays(rng: np.random.Generator, avenue: Avenue) -> Mesh:
    corners = np.concatenate([
        quads((avenue.ends[0], low), (avenue.ends[1], low + BAY_M - LANE_M), 0.5)
        for low in (LANE_M, -BAY_M)
    ])  # fmt: skip
    return level(corners, corners / 2.048)


def _repair(ground: BlockGround, rng: np.random.Generator, avenue: Avenue, wear: float) -> None:
    """Mend trenches, seal cracks with tar and set covers into the lanes."""
    patches: list[Mesh] = []
    cracks: list[Mesh] = []
    covers: list[Mesh] = []
    start, end = avenue.ends
    for x in np.arange(start + 2, end - 6, 3.1):
        side = float(rng.choice((-1, 1)))
        low = STRIP_M + 0.1 if side > 0 else -LANE_M + 0.1
        if rng.random() < 0.45 * wear:
            size = rng.uniform((0.6, 0.6), (4.5, 2.6))
            y = low + rng.uniform(0, LANE_M - STRIP_M - 0.2 - size[1])
            cells = (int(size[0] / 0.5) + 1, int(size[1] / 0.5) + 1)
            at = (x, y, MARK_M * rng.uniform(0.7, 1.2))
            mend = patch(at, (size[0], 0, 0), (0, size[1], 0), cells, (1.024, 1.024), rng.random(2))
            patches.append(mend)
            rim = np.array(
                [(x, y), (x + size[0], y), (x + size[0], y + size[1]), (x, y + size[1]), (x, y)]
            )
            cracks.append(_band(rng, rim, 0.035))
        if rng.random() < wear:
            cracks.append(_crack(rng, x, low))
        if rng.random() < 0.2:
            covers.append(
                patch((x, low + rng.uniform(0.4, 2.2), 4 * MARK_M), (0.6, 0, 0), (0, 0.6, 0))
            )
    seam = [
        np.column_stack([np.arange(start, end, 1.5), 0 * np.arange(start, end, 1.5) + y])
        for y in (-LANE_M - 0.02, LANE_M + 0.02)
    ]
    cracks += [_band(rng, line + rng.normal(0, 0.012, line.shape) * (0, 1), 0.04) for line in seam]
    ground.draw("mended", merged(patches))
    ground.draw("tar", merged(cracks))
    ground.draw("cover", merged(covers))
    ground.draw("tar", _spots(rng, avenue, 18 * int(end - start), (0.008, 0.03)))
    ground.draw("frame", _spots(rng, avenue, 12 * int(end - start), (0.006, 0.02)))


def _spots(
    rng: np.random.Generator, avenue: Avenue, count: int, radius_m: tuple[float, float]
) -> Mesh:
    """Scatter stains, grit and what has been dropped over lanes and bays: irregular squares."""
    across = rng.uniform(STRIP_M, BAY_M, count) * rng.choice((-1, 1), count)
    middle = np.column_stack([rng.uniform(*avenue.ends, count), across])[:, None]
    turn = rng.uniform(0, 2 * np.pi, (count, 1)) + np.pi / 2 * np.arange(4)
    size = rng.uniform(*radius_m, (count, 1)) * rng.uniform(0.6, 1.4, (count, 4))
    corners = middle + size[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return level(corners, corners / 0.4, 3 * MARK_M)


def _crack(rng: np.random.Generator, x: float, low: float) -> Mesh:
    """Let a crack wander along or across a lane."""
    steps = int(rng.integers(8, 26))
    heading = rng.choice((0.0, np.pi / 2)) + np.cumsum(rng.normal(0, 0.28, steps))
    line = np.cumsum(0.22 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    line += (x, low + rng.uniform(0.2, 1.2))
    inside = (abs(line[:, 1]) > STRIP_M + 0.03) & (abs(line[:, 1]) < LANE_M - 0.03)
    line = line[: max(3, int(np.argmin(inside)) if not inside.all() else steps)]
    line[:, 1] = np.clip(line[:, 1], low, low + LANE_M - STRIP_M - 0.2)
    return _band(rng, line, rng.uniform(0.012, 0.03))


def _band(rng: np.random.Generator, line: Array, width_m: float) -> Mesh:
    """Draw a band of a width along (N, 2) points, a little above the patches."""
    way = np.diff(line, axis=0)
    side = np.column_stack([-way[:, 1], way[:, 0]]) / np.linalg.norm(way, axis=1, keepdims=True)
    half = 0.5 * width_m * rng.uniform(0.7, 1.3, (len(way), 1)) * side
    corners = np.stack(
        [line[:-1] - half, line[1:] - half, line[1:] + half, line[:-1] + half], axis=1
    )
    return level(corners, corners / 0.4, MARK_M * rng.uniform(1.5, 1.9))


def _markings(rng: np.random.Generator, avenue: Avenue) -> Mesh:
    """Paint dashes between lanes and bays, and the bays' own lines."""
    dashes: list[Mesh] = []
    for side in (-1, 1):
        y = side * (LANE_M - 0.14)
        for x in np.arange(avenue.ends[0], avenue.ends[1] - 1.2, 3.0):
            spot = (x, y - 0.06, 2.4 * MARK_M)
            dashes.append(
                patch(spot, (1.1, 0, 0), (0, 0.12, 0), (2, 1), (2.048, 0.12), (rng.random(), 0))
            )
        for x in np.arange(avenue.ends[0], avenue.ends[1], 6.2):
            low = LANE_M + 0.1 if side > 0 else -BAY_M + 0.1
            spot = (x + 0.12, low, 2.4 * MARK_M)
            across = (0, BAY_M - LANE_M - 0.2, 0)
            dashes.append(
                patch(spot, across, (-0.12, 0, 0), (3, 1), (2.048, 0.12), (rng.random(), 0))
            )
    return merged(dashes)


def _kerbs(stage: Stage, rng: np.random.Generator, avenue: Avenue) -> Mesh:
    """Set kerbstones a metre long along the bays and around the green strip; they collide."""
    width, high = KERB_M
    rows = [(*avenue.ends, BAY_M), (*avenue.ends, -BAY_M - width)]
    for start, end in avenue.strips:
        rows += [(start, end, STRIP_M - width), (start, end, -STRIP_M)]
    lows: list[Array] = []
    sizes: list[Array] = []
    for k, (start, end, y) in enumerate(rows):
        x = np.linspace(start, end, max(2, round(end - start) + 1))
        lows.append(np.column_stack([x[:-1], 0 * x[:-1] + y, 0 * x[:-1] - 0.05]))
        top = high + 0.05 + rng.normal(0, 0.002, len(x) - 1)
        sizes.append(np.column_stack([np.diff(x) - 0.012, 0 * top + width, top]))
        middle = ((start + end) / 2, y + width / 2, high / 2)
        stage.obstacle(f"kerb_{k}", middle, (end - start, width, high))
    for k, (start, end) in enumerate(avenue.strips):
        for j, x in enumerate((start, end - width)):
            y = np.linspace(-STRIP_M + width, STRIP_M - width, 5)
            lows.append(np.column_stack([0 * y[:-1] + x, y[:-1], 0 * y[:-1] - 0.05]))
            sizes.append(np.tile((width, y[1] - y[0] - 0.012, high + 0.05), (4, 1)))
            stage.obstacle(
                f"kerb_end_{k}_{j}", (x + width / 2, 0, high / 2), (width, 2 * y[-1], high)
            )
    low, size = np.concatenate(lows), np.concatenate(sizes)
    return boxes(low, low + size, 1.2, rng.random(2))


def _pavements(rng: np.random.Generator, avenue: Avenue, atlas: Atlas) -> Mesh:
    start, end = avenue.ends
    low = BAY_M + KERB_M[0]
    rows = round((PAVED_M - low) / TILE_M)
    laid: list[Mesh] = []
    for side in (-1, 1):
        corners = quads((start, 0.0), (end, rows * TILE_M), TILE_M)
        uv = tiled(rng, corners, TILE_M, atlas)
        placed = corners * (1, (PAVED_M - low) / (rows * TILE_M))
        placed = placed + np.array((0.0, low if side > 0 else -PAVED_M))
        laid.append(level(placed, uv, PAVEMENT_M))
    return merged(laid)


def _green(ground: BlockGround, rng: np.random.Generator, k: int, start: float, end: float) -> None:
    """Sow one piece of the green strip, with uncut grass and fallen leaves."""
    inner = STRIP_M - KERB_M[0]
    corners = quads((start, -inner), (end, inner), TILE_M)
    ground.draw("turf", level(corners, scattered(rng, corners, TILE_M, 2.05), VERGE_M))
    count = int(14 * (end - start))
    low = (start, -inner, VERGE_M)
    feet = rng.uniform(low, (end, inner, VERGE_M), (5 * count, 3))
    high, wide = rng.uniform(0.04, 0.16, len(feet)), rng.uniform(0.012, 0.03, len(feet))
    ground.draw("blades", grass(rng, feet, high, wide))
    fallen = rng.uniform(low, (end, inner, VERGE_M), (count, 3)) + np.array([0, 0, 0.01])
    ground.draw("litter", litter(rng, fallen, ground.stage.atlases["litter"]))
    middle, size = ((start + end) / 2, 0, VERGE_M / 2), (end - start, 2 * inner, VERGE_M)
    ground.stage.obstacle(f"green_{k}", middle, size, shadow=False)


def _land(rng: np.random.Generator, avenue: Avenue) -> Mesh:
    """Cover the plots, and all that lies around the avenue."""
    (start, end), far = avenue.ends, PLOT_M
    fields = [((start, y), (end, y + 4.0), 1.0) for y in (PAVED_M, -PAVED_M - 4)]
    near = np.concatenate([quads(*field) for field in fields])
    outer = [
        ((start, PAVED_M + 4), (end, far), 2.0),
        ((start, -far), (end, -PAVED_M - 4), 2.0),
        ((start - 40, -far), (start, far), 2.0),
        ((end, -far), (end + 40, far), 2.0),
    ]
    beyond = np.concatenate([quads(*field) for field in outer])
    return merged([
        level(near, scattered(rng, near, 1.0, 2.05), PAVEMENT_M - 0.02),
        level(beyond, beyond / 2.05, PAVEMENT_M - 0.03),
    ])  # fmt: skip
