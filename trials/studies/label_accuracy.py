"""Accuracy of labels, blur and sensors against independent computations.

`driftyard label-accuracy` compares depth with ray casts, outlines with projected corners, labels
with pixels under noise, adaptive blur with many sub-frames, and inertial readings and wheel
encoders with the path.
"""

import tempfile
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import mujoco
import numpy as np

from scenes.scene import LABEL_GROUP, Scene
from sim.batch import build
from sim.camera.camera import place_and_render
from sim.camera.exposure import expose, open_shutter
from sim.camera.render import StereoRenderer
from sim.imaging.linear_light import Encoding, decode
from sim.record import record
from sim.settings import RecordSettings
from sim.world.trip import Trip, make_trip
from sim.world.world import World, build_world
from trials.execution.executor import compute
from trials.execution.progress import ProgressBar, counted, no_progress
from trials.execution.recording_settings import recording_settings
from trials.execution.tasks import Task
from vo.contract.arrays import Array

DISTANCE_M = 3.0
NOISE = ("sensor.full_well=6000", "sensor.read_noise=15", "sensor.softness_px=0.6")
FLOW = ("labels.flow=true", "labels.covisibility=true")
RAYS_EVERY_PX = 7
MAX_CURVATURE = 1e-4
"""Largest second difference of 1/Z over 1/Z: it is zero on a plane, and above this at an edge."""
REFERENCE_SUBFRAMES = 64
FRAMES = 6
DEPTH_SHARE, STRAY_SHARE = 2e-4, 1e-3
"""Largest relative error of a depth, and fraction of rays that may exceed it at thin objects."""
BEHIND_M = 1e-5
"""Distance behind a back face from which a ray continues, metres."""


class Check(NamedTuple):
    """A measurement and its limit."""

    measured: str
    scene: str
    found: str
    limit: str
    holds: bool


def measure_labels(scenes: Sequence[str], seed: int, bar: ProgressBar = no_progress) -> list[Check]:
    """Compare labels, blur and sensors with independent computations, on all cores."""
    measures = [(x, name) for name in scenes for x in (_geometry, _sensors)]
    measures += [(_outlines, "boxes"), (_blur, "turntable")]
    tasks = [
        Task("check", f"{x.__name__[1:]} of {y}", x, (y, seed), list[Check]) for x, y in measures
    ]
    with counted(bar, "measures", len(tasks)) as count:
        return [check for found in compute(tasks, count) for check in found]


def _geometry(scene: str, seed: int) -> list[Check]:
    """Compare depth labels along a drive with MuJoCo's ray caster."""
    pairs: list[Array] = []
    world, trip, settings = _drive(scene, seed, [f"drive.distance_m={DISTANCE_M}"])
    with StereoRenderer(world, settings.render) as renderer:
        for k in np.linspace(0, len(trip) - 1, FRAMES).astype(int):
            time_ns = int(trip.timestamps_ns[k])
            world.place(time_ns * 1e-9, trip.states.at(world.model, time_ns))
            pairs.append(np.stack(_depth_and_rays(world, renderer)))
    depth, cast = np.hstack(pairs)
    error = np.abs(depth - cast)
    near_mm = float(1e3 * error[np.abs(cast - 1.0) < 0.2].max(initial=0))
    found = f"{near_mm:.4f} mm"
    near = Check("depth against rays at 1 m, largest", scene, found, "0.2 mm", near_mm <= 0.2)
    share = np.sort((error / cast)[cast < 20])[::-1]
    beyond, strays = int((share > DEPTH_SHARE).sum()), STRAY_SHARE * len(share)
    found = f"{100 * share[int(strays)]:.5f} %, {beyond} of {len(share)} above"
    label = "depth against rays to 20 m, all but 1 in 1000"
    return [near, Check(label, scene, found, "0.02 %", beyond <= strays)]


def _depth_and_rays(world: World, renderer: StereoRenderer) -> tuple[Array, Array]:
    """Return depth label and ray cast (N,) at pixels of a grid that are not at an edge."""
    geometry = renderer.render_geometry()
    depth, rig = geometry.depth_left_m.astype(float), world.render_rig
    rows, columns = (np.arange(2, x - 2, RAYS_EVERY_PX) for x in (rig.height_px, rig.width_px))
    v, u = (x.ravel() for x in np.meshgrid(rows, columns, indexing="ij"))
    q = 1 / depth
    curvature = [
        np.abs(q[v - dv, u - du] - 2 * q[v, u] + q[v + dv, u + du]) / q[v, u]
        for du, dv in ((1, 0), (0, 1), (1, 1), (1, -1))
    ]
    smooth = np.max(curvature, axis=0) < MAX_CURVATURE
    u, v = u[smooth], v[smooth]
    rays_cam = np.column_stack([rig.normalized(np.column_stack([u, v])), np.ones(len(u))])
    T_world_cam = world.T_world_cam
    norms = np.linalg.norm(rays_cam, axis=1)
    directions = (rays_cam / norms[:, None]) @ T_world_cam[:3, :3].T
    centre = T_world_cam[:3, 3].copy()
    distances = np.array([_first_front(world, centre, direction) for direction in directions])
    hit = np.isfinite(distances)
    return depth[v, u][hit], (distances / norms)[hit]


def _first_front(world: World, start_m: Array, direction: Array) -> float:
    """Return the distance along a ray to the first front face; NaN if there is none.

    The renderer culls back faces, the ray caster does not.
    """
    groups = np.zeros(6, np.uint8)
    groups[[0, 1, 2, LABEL_GROUP]] = 1
    geom, normal, passed_m = np.zeros(1, np.int32), np.zeros(3), 0.0
    while True:
        start = start_m + passed_m * direction
        ahead_m = mujoco.mj_ray(
            world.model, world.data, start, direction, groups, 1, -1, geom, normal
        )
        if ahead_m < 0:
            return np.nan
        passed_m += ahead_m
        if normal @ direction < 0:
            return passed_m
        passed_m += BEHIND_M


def _sensors(scene: str, seed: int) -> list[Check]:
    """Read the certificates of a noisy drive and of one with perfect inertial readings."""
    base = [f"drive.distance_m={DISTANCE_M}", *FLOW]
    noisy = _certificate(scene, seed, [*base, *NOISE])
    exact = _certificate(scene, seed, [base[0], "imu.noise=0"])
    checks: list[Check] = []
    for part in ("stereo", "flow"):
        ratio = noisy[part]["median_grey"] / noisy[part]["noise_median_grey"]
        label, holds = f"{part} residual over that of noise alone", 0.8 <= ratio <= 1.2
        checks.append(Check(label, scene, f"{ratio:.3f}", "0.8 to 1.2", holds))
    drift_mm, turn_deg = 1e3 * exact["inertial"]["drift_max_m"], exact["inertial"]["turn_max_deg"]
    label = "inertial readings without noise, integrated 5 s"
    found = f"{drift_mm:.2f} mm, {turn_deg:.4f}°"
    holds = drift_mm <= 10 and turn_deg <= 0.05
    checks.append(Check(label, scene, found, "10 mm, 0.05°", holds))
    slip, label = exact["encoders"]["slip_percent"], "path by the encoders against truth"
    return [*checks, Check(label, scene, f"{slip:+.2f} %", "±2 %", abs(slip) <= 2)]


def _certificate(scene: str, seed: int, overrides: list[str]) -> dict[str, Any]:
    settings = recording_settings(scene, seed, overrides)
    with tempfile.TemporaryDirectory() as name:
        return record(build(scene, settings), settings, Path(name) / scene).certificate


def _outlines(scene: str, _: int) -> list[Check]:
    """Compare the pixels of floating boxes with their projected outlines."""
    world, settings = _boxes()
    misplaced, inspected = 0, 0
    with StereoRenderer(world, settings.render) as renderer:
        geometry = renderer.render_geometry()
    rig = world.render_rig
    v, u = np.mgrid[: rig.height_px, : rig.width_px]
    for camera, geoms in enumerate((geometry.geoms_left, geometry.geoms_right)):
        for name, corners_world in _corners(world).items():
            cam = (np.linalg.inv(world.T_world_cam) @ np.c_[corners_world, np.ones(8)].T).T[:, :3]
            pixels = rig.project(cam - [camera * rig.baseline_m, 0, 0])[:, :2]
            hull = cv2.convexHull(pixels.astype(np.float32))[:, 0].astype(float)
            gap = _signed_gap(hull, np.stack([u, v], axis=-1).astype(float))
            shown = geoms == world.model.geom(name).id
            misplaced += int((shown & (gap < -0.05)).sum() + (~shown & (gap > 0.05)).sum())
            inspected += int((np.abs(gap) < 1).sum())
    found = f"{misplaced} of {inspected} pixels at outlines"
    label = "pixels beyond projected corners by 0.05 px"
    return [Check(label, scene, found, "none", misplaced == 0)]


def _signed_gap(hull: Array, points: Array) -> Array:
    """Return the distance of (..., 2) points from a convex (K, 2) polygon, positive inside."""
    edges = np.roll(hull, -1, axis=0) - hull
    normals = edges[:, ::-1] * [-1, 1] / np.linalg.norm(edges, axis=1)[:, None]
    normals *= np.sign(((hull.mean(axis=0) - hull) * normals).sum(axis=1))[:, None]
    return np.min([(points - a) @ normal for a, normal in zip(hull, normals, strict=True)], axis=0)


def _boxes() -> tuple[World, RecordSettings]:
    """Place four floating boxes before the rig, none of which hides another."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 1))
    places = ((0.9, 0.2, 0.15), (1.2, -0.3, 0.2), (2.5, 0.6, 0.3), (4.0, -0.8, 0.5))
    for k, (pos, yaw) in enumerate(zip(places, (0.3, -0.4, 0.7, 0.1), strict=True)):
        spec.worldbody.add_geom(
            name=f"box_{k}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=pos, size=(0.05, 0.07, 0.04),
            quat=(np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)),
        )  # fmt: skip
    route = {"default": np.array([[0.0, 0.0], [3.0, 0.0]])}
    scene = Scene("boxes", "Outlines.", spec, route, (-1.0, -2.0, 5.0, 2.0))
    settings = RecordSettings()
    world = build_world(scene, settings)
    mujoco.mj_step(world.model, world.data, 1000)
    world.place_bodies()
    return world, settings


def _corners(world: World) -> dict[str, Array]:
    """Return the (8, 3) corners in the world of each box, by name."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    boxes = [world.model.geom(f"box_{k}") for k in range(4)]
    return {
        box.name: world.data.geom_xpos[box.id]
        + (signs * box.size) @ world.data.geom_xmat[box.id].reshape(3, 3).T
        for box in boxes
    }


def _blur(scene: str, seed: int) -> list[Check]:
    """Compare exposures on the turntable and at rest with one of 64 sub-frames."""
    world, trip, settings = _drive(scene, seed, ["drive.distance_m=6", "exposure.time_ms=20"])
    speed = np.abs(np.gradient(np.unwrap(np.arctan2(*trip.T_world_body[:, 1::-1, 0].T))))
    fast = np.argsort(speed)[-FRAMES:]
    encode = Encoding("srgb")
    psnr_db: list[float] = []
    counts: list[int] = []
    reference_settings = {"step_px": 1e-6, "subframes_max": REFERENCE_SUBFRAMES}
    finest = settings.exposure.model_copy(update=reference_settings)
    with StereoRenderer(world, settings.render) as renderer:
        for k in [*fast, len(trip) - 1]:
            time_ns = int(trip.timestamps_ns[k])
            geometry = cache(partial(place_and_render, world, trip, renderer, time_ns))
            time_s = time_ns * 1e-9
            shutter = open_shutter(settings.exposure, time_s, 0.02, world.render_rig.height_px)
            image, count = expose(world, trip, renderer, settings.exposure, shutter, geometry)
            reference, _ = expose(world, trip, renderer, finest, shutter, geometry)
            grey = image[0] if image[0].dtype == np.uint8 else encode(image[0])
            light = reference[0] if reference[0].dtype != np.uint8 else decode(reference[0])
            psnr_db.append(cv2.PSNR(grey, encode(light)))
            counts.append(count)
    worst, most, least = min(psnr_db), max(counts[:-1]), counts[-1]
    label = "adaptive blur against 64 sub-frames, worst"
    return [
        Check(label, scene, f"{worst:.1f} dB", "45 dB", worst >= 45),
        Check("sub-frames in the fastest turns, most", scene, f"{most}", "32", most <= 32),
        Check("sub-frames at rest", scene, f"{least}", "1", least == 1),
    ]


def _drive(scene: str, seed: int, overrides: list[str]) -> tuple[World, Trip, RecordSettings]:
    settings = recording_settings(scene, seed, overrides)
    world = build_world(build(scene, settings), settings)
    return world, make_trip(world, settings), settings
