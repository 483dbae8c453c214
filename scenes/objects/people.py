"""Pedestrians, trolleys and robot carriers that move through a scene."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, box, grid, merged, sphere, tube
from scenes.geometry.routes import arc_lengths
from scenes.scene import Kind, Motion
from scenes.stage import Stage
from scenes.surfaces import textile, timber
from vo.contract import se3
from vo.contract.arrays import Array, Image

LEG_M = 0.86
SWING_RAD = 0.4
STRIDE_M = 4 * LEG_M * np.sin(SWING_RAD)
"""Distance from one left step to the next at which the standing foot does not slide."""
TURN_S = 1.3
"""Time in which a pedestrian turns round before walking back."""
CLOTHES = (
    (58, 66, 84), (126, 64, 58), (84, 98, 80), (176, 160, 132), (70, 70, 74), (148, 128, 88),
    (96, 112, 138), (188, 184, 176), (60, 58, 62), (74, 82, 104), (104, 94, 82), (46, 50, 58),
)  # fmt: skip
SKINS = ((206, 164, 138), (160, 116, 90), (108, 76, 58), (222, 184, 160))
HAIRS = ((52, 42, 36), (96, 72, 50), (150, 128, 96), (120, 118, 116))

Walk = Callable[[float], tuple[Array, float, float]]
"""Time in seconds to (2,) place in metres, heading in radians and distance walked in metres."""


@dataclass(frozen=True)
class Lap:
    """A walk around a closed path, (N, 2) metres, at constant speed, negative against its sense.

    The last point of the path equals the first; the walk begins `start_m` along it.
    """

    path: Array
    pace_mps: float
    start_m: float

    @cached_property
    def marks_m(self) -> Array:
        """Arc length along the path to each of its points: (N,)."""
        return arc_lengths(self.path)

    def __call__(self, time_s: float) -> tuple[Array, float, float]:
        """See `Walk`."""
        marks = self.marks_m
        way = self.start_m + self.pace_mps * time_s
        here, ahead = (
            np.array([np.interp(s % marks[-1], marks, self.path[:, k]) for k in (0, 1)])
            for s in (way, way + np.copysign(0.3, self.pace_mps))
        )
        return here, float(np.arctan2(*(ahead - here)[::-1])), abs(self.pace_mps) * time_s


@dataclass(frozen=True)
class Crossing:
    """Walks to and fro between two places, (2,) metres, at one speed, with a stop at either end.

    The times (K,) are the start of each walk, the first one from `start`.
    """

    start: Array
    end: Array
    times_s: Array
    pace_mps: float

    def __call__(self, time_s: float) -> tuple[Array, float, float]:
        """See `Walk`."""
        span = self.end - self.start
        length = float(np.linalg.norm(span))
        towards = float(np.arctan2(span[1], span[0]))
        begun = int(np.searchsorted(self.times_s, time_s))
        until = self.times_s[begun] - time_s if begun < len(self.times_s) else np.inf
        turned = float(np.clip(1 - until / TURN_S, 0, 1))
        heading = towards + np.pi * (begun - 1 + turned)
        if not begun:
            return self.start, towards, 0.0
        way = min(self.pace_mps * (time_s - self.times_s[begun - 1]), length)
        share = way / length if begun % 2 else 1 - way / length
        return self.start + share * span, heading, way


def clothing_atlas(rng: np.random.Generator) -> Image:
    """Draw cloths, then skins, then hair, then leather, each a cell of 128 pixels."""
    cells = [textile.fabric(rng, 128, rgb) for rgb in CLOTHES]
    cells += [timber.painted(rng, (128, 128), rgb) for rgb in SKINS + HAIRS + ((40, 36, 34),)]
    return np.stack(cells)


def placed(walk: Walk, ahead_m: float = 0.0) -> Motion:
    """Move something upright along a walk, `ahead_m` before the pedestrian."""

    def motion(time_s: float) -> Array:
        place, heading, _ = walk(time_s)
        return _upright(place, heading, 0.0) @ se3.pose(np.eye(3), np.array([ahead_m, 0, 0]))

    return motion


def person(
    stage: Stage, name: str, rng: np.random.Generator, walk: Walk, arms_m: float = 0.0
) -> None:
    """Let a figure about 1.75 m high walk; `arms_m` is how far the hands reach forward."""
    scale = rng.uniform(0.92, 1.05)
    clothes = stage.atlases["clothes"]
    coat, legs = (clothes.rects[k] for k in rng.integers(len(CLOTHES), size=2))
    skin = clothes.rects[len(CLOTHES) + rng.integers(len(SKINS))]
    hair = clothes.rects[len(CLOTHES) + len(SKINS) + rng.integers(len(HAIRS))]
    leather = clothes.rects[-1]
    body = _torso(rng, coat, skin, hair, leather, arms_m)
    hip = LEG_M * scale

    def torso_motion(time_s: float) -> Array:
        place, heading, way = walk(time_s)
        swing = SWING_RAD * np.sin(2 * np.pi * way / (STRIDE_M * scale))
        return _upright(place, heading, hip * (np.cos(swing) - 1))

    with stage.mover(name, torso_motion):
        stage.draw("clothes", replace(body, points=scale * body.points))
        stage.obstacle(name, (0.0, 0.0, 0.9), (0.34, 0.5, 1.7))
    leg = _leg(legs, leather)
    for side in (-1.0, 1.0):
        limb = f"{name}_{'left' if side > 0 else 'right'}_leg"
        with stage.mover(limb, _swinging(walk, side, hip, scale)), stage.object(name, Kind.MOVING):
            stage.draw("clothes", replace(leg, points=scale * leg.points))


def _swinging(walk: Walk, side: float, hip_m: float, scale: float) -> Motion:
    def motion(time_s: float) -> Array:
        place, heading, way = walk(time_s)
        swing = SWING_RAD * np.sin(2 * np.pi * way / (STRIDE_M * scale))
        c, s = np.cos(side * swing), np.sin(side * swing)
        T_hip_leg = np.array([[c, 0, -s, 0], [0, 1, 0, 0], [s, 0, c, 0], [0, 0, 0, 1.0]])
        at_hip = se3.pose(np.eye(3), np.array([0, 0.095 * side, hip_m * np.cos(swing)]))
        return _upright(place, heading, 0.0) @ at_hip @ T_hip_leg

    return motion


def _torso(
    rng: np.random.Generator, coat: Array, skin: Array, hair: Array, leather: Array, arms_m: float
) -> Mesh:
    """Build all of a figure but its legs, standing on z = 0 and facing along x."""
    low = rng.uniform(0.5, 0.8)  # the hem: of a coat or of a jacket
    trunk = tube((0, 0, low), (0, 0, 1.18), 0.19, 14, 0.98)
    chest = tube((0, 0, 1.18), (0, 0, 1.44), 0.186, 14, 0.78)
    narrow = np.array([0.66, 1.0, 1.0])
    parts = [replace(m, points=m.points * narrow).textured(coat) for m in (trunk, chest)]
    for side in (-1, 1):
        shoulder = np.array([0.0, 0.2 * side, 1.4])
        elbow = shoulder + np.array([-0.02 + 0.35 * arms_m, 0.045 * side, -0.29])
        hand = elbow + np.array([0.05 + 0.65 * arms_m, -0.01 * side, -0.26 + 0.4 * arms_m])
        parts.append(tube(shoulder, elbow, 0.058, 9, 0.85).textured(coat))
        parts.append(tube(elbow, hand, 0.05, 9, 0.8).textured(coat))
        parts.append(_ellipsoid(hand, (0.045, 0.03, 0.06)).textured(skin))
        parts.append(_ellipsoid(shoulder, (0.07, 0.075, 0.065)).textured(coat))
    parts.append(tube((0, 0, 1.42), (0.01, 0, 1.53), 0.055, 10).textured(skin))
    parts.append(_ellipsoid((0.015, 0, 1.62), (0.095, 0.078, 0.125)).textured(skin))
    parts.append(_ellipsoid((-0.012, 0, 1.655), (0.1, 0.088, 0.115)).textured(hair))
    if rng.random() < 0.45 and not arms_m:
        rucksack = box((-0.2, 0, 1.14), (0.16, 0.3, 0.44), cell_m=0.15, bottom=True)
        parts.append(rucksack.textured(leather))
    elif not arms_m and rng.random() < 0.5:
        bag = box((0.03, 0.27, 0.66), (0.34, 0.12, 0.26), cell_m=0.15, bottom=True)
        parts.append(bag.textured(leather))
    return merged(parts)


def _leg(cloth: Array, leather: Array) -> Mesh:
    """Build a leg that hangs from the hip at the origin, a shoe at its end."""
    knee, ankle = (0.012, 0, -0.43), (-0.01, 0, -0.8)
    thigh, shin = tube((0, 0, 0.02), knee, 0.085, 10, 0.74), tube(knee, ankle, 0.066, 10, 0.82)
    shoe = _ellipsoid((0.045, 0, -LEG_M + 0.04), (0.135, 0.048, 0.045))
    return merged([thigh.textured(cloth), shin.textured(cloth), shoe.textured(leather)])


def _ellipsoid(centre: Vector, radii: Vector) -> Mesh:
    """Build an upright ellipsoid of (3,) radii; u runs once around, v from top to bottom."""
    theta, phi, unit = sphere(7, 11)
    uv = np.stack([phi / (2 * np.pi), theta / np.pi], axis=-1)
    return grid(np.asarray(centre) + np.asarray(radii) * unit, uv, unit)


def _upright(place: Array, heading_rad: float, z_m: float) -> Array:
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return np.array([[c, -s, 0, place[0]], [s, c, 0, place[1]], [0, 0, 1, z_m], [0, 0, 0, 1.0]])


def trolley(stage: Stage, name: str, rng: np.random.Generator, motion: Motion) -> None:
    """Let a platform trolley of 1.1 x 0.65 m roll along x, loaded with cartons."""
    with stage.mover(name, motion):
        stage.draw("steel", box((0, 0, 0.2), (1.1, 0.65, 0.06), (0.5, 0.5), bottom=True))
        for y in (-0.28, 0.28):
            stage.draw("steel", tube((-0.53, y, 0.2), (-0.53, y, 0.98), 0.017, 8))
            for x in (-0.42, 0.42):
                stage.draw("dark", tube((x, y - 0.02, 0.08), (x, y + 0.02, 0.08), 0.08, 12))
        stage.draw("steel", tube((-0.53, -0.29, 0.98), (-0.53, 0.29, 0.98), 0.017, 8))
        base = 0.23
        for x in (-0.22, 0.28):
            top = base
            for _ in range(int(rng.integers(1, 4))):
                size = rng.uniform((0.38, 0.42, 0.24), (0.46, 0.6, 0.36))
                block = box((x, rng.normal(0, 0.02), top + size[2] / 2), size, cell_m=0.3)
                stage.draw("cartons", block.textured(stage.pick("cartons", rng)))
                top += float(size[2])
        stage.obstacle(name, (0.0, 0.0, 0.5), (1.12, 0.66, 0.96))


def roll_cage(stage: Stage, name: str, rng: np.random.Generator, motion: Motion) -> None:
    """Let a roll cage of 0.85 x 0.7 x 1.7 m, full of cartons, roll along x."""
    with stage.mover(name, motion):
        stage.draw("steel", box((0, 0, 0.19), (0.85, 0.7, 0.04), (0.5, 0.5), bottom=True))
        for x in (-0.4, 0.4):
            for y in (-0.33, 0.33):
                stage.draw("steel", tube((x, y, 0.19), (x, y, 1.7), 0.015, 8))
                stage.draw("dark", tube((x, y - 0.02, 0.08), (x, y + 0.02, 0.08), 0.08, 12))
            for z in np.arange(0.45, 1.71, 0.25):
                stage.draw("steel", tube((x, -0.33, z), (x, 0.33, z), 0.008, 6))
            for y in np.arange(-0.22, 0.23, 0.11):
                stage.draw("steel", tube((x, y, 0.19), (x, y, 1.7), 0.006, 6))
        for x, y in ((-0.19, -0.16), (-0.19, 0.16), (0.2, -0.16), (0.2, 0.16)):
            top = 0.21
            while top < 1.3:
                size = rng.uniform((0.3, 0.26, 0.2), (0.36, 0.31, 0.4))
                block = box((x, y, top + size[2] / 2), size, cell_m=0.3)
                stage.draw("cartons", block.textured(stage.pick("cartons", rng)))
                top += float(size[2])
        stage.obstacle(name, (0.0, 0.0, 0.85), (0.86, 0.7, 1.66))


def carrier(stage: Stage, name: str, motion: Motion) -> None:
    """Let a low robot carrier of 0.9 x 0.6 m roll along x."""
    with stage.mover(name, motion):
        stage.draw("shell", box((0, 0, 0.2), (0.9, 0.6, 0.26), (0.9, 0.6), bottom=True))
        stage.draw("hazard", box((0, 0, 0.1), (0.915, 0.615, 0.1), (0.4, 0.4)))
        stage.draw("dark", box((0, 0, 0.04), (0.8, 0.5, 0.07)))
        stage.draw("steel", tube((-0.36, 0.2, 0.33), (-0.36, 0.2, 0.95), 0.014, 8))
        stage.draw("cone", tube((-0.36, 0.2, 0.95), (-0.36, 0.2, 1.03), 0.035, 12))
        stage.obstacle(name, (0.0, 0.0, 0.2), (0.92, 0.62, 0.38))
