"""The hand-held carrier: a person who walks the route with the rig in both hands."""

import math

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from scenes.geometry.routes import arc_lengths
from scenes.scene import Motion, Scene
from scenes.surfaces.noise import smoothstep
from sim.settings import DriveSettings, HandheldSettings
from sim.world.rover import BODY, MAST, PREFIX, WHEEL_RADIUS_M
from vo.contract import se3
from vo.contract.arrays import Array

STEP_HZ = 1.8
TREMOR_HZ = (4.0, 12.0)
TREMOR_WAVES = 9
HEADING_KNOT_M = 0.4
"""Spacing of the spline's knots, which sets how round the turns are."""


def build_hand() -> mujoco.MjSpec:
    """Build a kinematic body without mass, wheels or contact."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name=BODY.removeprefix(PREFIX), mocap=True).add_body(name=MAST)
    return spec


def walk(
    scene: Scene,
    points: Array,
    drive: DriveSettings,
    hand: HandheldSettings,
    start_s: float,
    rng: np.random.Generator,
) -> tuple[Motion, float]:
    """Plan the motion of the rig's body along (N, 2) evenly spaced points, metres, from `start_s`.

    The body has the rover's height above the ground, faces along a spline through the route, and
    sways with the steps, at half their rate sideways; the hands add a tremor of random waves. It
    starts, ends and halts at rest. The motion is defined beyond the time of arrival, seconds, too.
    """
    marks = arc_lengths(points)
    knots = np.linspace(0, marks[-1], max(4, round(marks[-1] / HEADING_KNOT_M) + 1))
    path = CubicSpline(knots, np.stack([np.interp(knots, marks, p) for p in points.T], axis=1))
    times_s, along_m = _schedule(float(marks[-1]), drive, start_s)
    progress = PchipInterpolator(times_s, along_m, extrapolate=False)
    waves = _Waves(hand, rng)

    def motion(time_s: float) -> Array:
        s = float(progress(np.clip(time_s, times_s[0], times_s[-1])))
        xy, along = path(s), path(s, 1)
        yaw = math.atan2(along[1], along[0])
        c, s = math.cos(yaw), math.sin(yaw)
        R_world_walker = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        height_m = float(scene.elevation(xy)) + WHEEL_RADIUS_M
        T_world_walker = se3.pose(R_world_walker, np.array([*xy, height_m]))
        return T_world_walker @ waves.at(time_s, time_s - start_s, times_s[-1] - time_s)

    return motion, float(times_s[-1])


def _schedule(length_m: float, drive: DriveSettings, start_s: float) -> tuple[Array, Array]:
    """Times and path lengths for monotone interpolation: legs that start and end at rest."""
    leg = drive.stop_every_m or length_m
    stops = [*np.arange(leg, length_m - 1e-6, leg), length_m]
    times, marks, at = [start_s], [0.0], 0.0
    for stop in stops:
        ramp_s = drive.speed_mps / drive.acceleration_mps2
        leg_s = (stop - at) / drive.speed_mps + ramp_s
        share = np.linspace(0, 1, max(8, round(leg_s * 4)))[1:]
        eased = _trapezoid(share * leg_s, leg_s, ramp_s) / _trapezoid(leg_s, leg_s, ramp_s)
        times += (times[-1] + share * leg_s).tolist()
        marks += (at + eased * (stop - at)).tolist()
        if drive.stop_s > 0 and stop < length_m:
            times.append(times[-1] + drive.stop_s)
            marks.append(float(stop))
        at = float(stop)
    return np.array(times), np.array(marks)


def _trapezoid(t: Array | float, total_s: float, ramp_s: float) -> Array:
    """Distance at unit top speed after acceleration for `ramp_s`, with equal deceleration."""
    ramp = min(ramp_s, total_s / 2)
    up, down = np.minimum(t, ramp), np.maximum(np.asarray(t) - (total_s - ramp), 0)
    steady = np.clip(t, ramp, total_s - ramp) - ramp
    return up**2 / (2 * ramp) + steady + down - down**2 / (2 * ramp)


class _Waves:
    """Sway and tremor as a small, smooth motion in the walker's frame."""

    def __init__(self, hand: HandheldSettings, rng: np.random.Generator) -> None:
        self._hand = hand
        self._step_phase = rng.uniform(0, 2 * np.pi)
        self._rate = 2 * np.pi * rng.uniform(*TREMOR_HZ, (TREMOR_WAVES, 6))
        self._phase = rng.uniform(0, 2 * np.pi, (TREMOR_WAVES, 6))
        self._size = np.sqrt(2 / TREMOR_WAVES)

    def at(self, time_s: float, since_start_s: float, until_end_s: float) -> Array:
        """Return the (4, 4) motion; steps fade in and out within a second of the walk's ends."""
        hand = self._hand
        tremor = self._size * np.sin(self._rate * time_s + self._phase).sum(axis=0)
        fade = smoothstep(0, 1, np.array([since_start_s, until_end_s])).prod()
        step = 2 * np.pi * STEP_HZ * time_s + self._step_phase
        bob, side = fade * math.sin(step), fade * math.sin(step / 2)
        shift = hand.sway_m * np.array([0.0, side, bob]) + hand.tremor_m * tremor[:3]
        turn_deg = hand.sway_deg * np.array([side, 0.5 * bob, 0.5 * side])
        turn_deg = turn_deg + hand.tremor_deg * tremor[3:]
        return se3.exp(np.concatenate([shift, np.radians(turn_deg)]))
