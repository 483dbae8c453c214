"""Sample views of a world before it is recorded: short trips from positions on its route."""

import math
from dataclasses import dataclass, replace

import numpy as np

from scenes.scene import Motion
from sim.camera.camera import FrameExposure, StereoCamera
from sim.camera.render import StereoRenderer
from sim.labels.annotate import Annotation, Annotator
from sim.preview.cameras import TopDownMap, chase_camera, render_world_map
from sim.preview.colours import rgb_of
from sim.settings import RecordSettings
from sim.world.drive import DriveError
from sim.world.path import plan_path
from sim.world.rover import PREFIX, WHEEL_RADIUS_M
from sim.world.start import START_CLEARANCE_M
from sim.world.trip import Trip, make_trip
from sim.world.world import START_S, World
from vo.contract import se3
from vo.contract.arrays import Array, Image

VIEWS = 6
REACH_M = (0.4, 1.0)
"""Smallest and largest length of a sample trip."""
WALK_S = START_S + 1.0
"""End of a sample walk."""
UNDER_WAY = 0.45
"""Fraction of a trip's frames before its view: at speed, and not yet braking."""
METERING_FRAMES = 8
"""Frames before the view in which the automatic exposure settles."""
HEADING_M = 0.05
CHASE_PX = (960, 720)


@dataclass(frozen=True)
class SampleView:
    """Left and right (H, W, 3) RGB images and labels of one moment on the route.

    Its position is (2,) world x, y in metres; its sample trip started `along_m` along the path.
    """

    along_m: float
    position: Array
    view: Image
    right: Image
    exposure: FrameExposure
    annotation: Annotation

    @property
    def variety(self) -> float:
        """Entropy of the depth in steps of a fifth, in bits."""
        steps = np.nan_to_num(np.log(self.annotation.depth) / math.log(1.2), nan=99).astype(int)
        share = np.unique(steps, return_counts=True)[1] / steps.size
        return float(-(share * np.log2(share)).sum())


@dataclass(frozen=True)
class SampleViews:
    """Rendered content of a contact sheet: one to VIEWS views evenly spaced along the route.

    `shown` is the index of the view with the most variety, whose labels are shown, with a view of
    the carrier there from behind, (H, W, 3) RGB.
    """

    settings: RecordSettings
    views: list[SampleView]
    shown: int
    chase: Image
    top_down: TopDownMap

    @property
    def best(self) -> SampleView:
        """The view whose labels are shown."""
        return self.views[self.shown]


def render_sample_views(world: World, settings: RecordSettings) -> SampleViews:
    """Render views of short trips from positions along the route; moves the world.

    Positions without space for the rover are left out.

    Raises:
        DriveError: If there is no space anywhere.
        GraphicsError: If there is no OpenGL.
    """
    annotator = Annotator(world)
    views: list[SampleView] = []
    failure: DriveError | None = None
    scenery: list[tuple[World, float, Array]] = []
    with StereoRenderer(world, settings.render, settings.rig.color) as renderer:
        for share in np.arange(VIEWS) / VIEWS:
            try:
                there, trip = short_trip(world, settings, share)
            except DriveError as error:  # no space here, but perhaps elsewhere
                failure = error
                continue
            camera = StereoCamera(there, settings)
            *_, now, following = camera.captures(trip, renderer)
            left, right = (rgb_of(image) for image in camera.form_images(now).rectified)
            where = share * world.path.length_m, trip.T_world_body[now.index][:2, 3]
            labels = annotator.annotate(now, following)
            views.append(SampleView(*where, left, right, now.exposure, labels))
            time_ns = now.exposure.timestamp_ns
            scenery.append((there, time_ns * 1e-9, trip.states.at(world.model, time_ns)))
        if not views:
            raise failure or DriveError("the rover cannot stand anywhere on its route")
        shown = int(np.argmax([view.variety for view in views]))
        there, time_s, qpos = scenery[shown]
        there.place(time_s, qpos)
        chase = renderer.render_view(chase_camera(there), *CHASE_PX)
        world.reset()
        world.move_movers(START_S)
        world.place_bodies()
        top_down = render_world_map(world, renderer)
    return SampleViews(settings, views, shown, chase, top_down)


def short_trip(world: World, settings: RecordSettings, share: float) -> tuple[World, Trip]:
    """Simulate a short trip from a share (0 to below 1) of the route, at its time on the real trip.

    In the world with its time shifted; only two successive frames of the trip are delivered, or
    some more before them for an automatic exposure.

    Raises:
        DriveError: If the rover tips over at once.
    """
    drive, path = settings.drive, world.path
    if world.arrival_s is not None:
        there = _later(world, share * (world.arrival_s - START_S))
        world.reset()
        trip = make_trip(replace(there, arrival_s=WALK_S), settings)
    else:
        along_m = share * path.length_m
        there = _later(world, along_m / drive.speed_mps)
        place_rover(there, settings, along_m)
        reach_m = float(np.clip(drive.speed_mps**2 / drive.acceleration_mps2, *REACH_M))
        end_m = min(along_m + reach_m, path.length_m)
        between = path.waypoints[(path.marks_m > along_m) & (path.marks_m < end_m)]
        way = np.vstack([path.at(along_m), between, path.at(end_m)])
        trip = make_trip(replace(there, path=plan_path(way, None)), settings)
    frame = min(int(UNDER_WAY * len(trip)), len(trip) - 2)
    first = frame - METERING_FRAMES if settings.sensor.auto_exposure else frame
    delivered = np.zeros(len(trip), bool)
    delivered[max(first, 0) : frame + 2] = True
    return there, replace(trip, delivered=delivered)


def place_rover(world: World, settings: RecordSettings, along_m: float) -> None:
    """Put the rover at rest on the slope of the ground, heading along the route."""
    scene, path = world.scene, world.path
    here, ahead = path.at(along_m), path.at(along_m + HEADING_M)
    forward = (ahead - here) / np.linalg.norm(ahead - here)
    left = np.array([-forward[1], forward[0]])
    clearance_m = START_CLEARANCE_M + 1e-3 * (settings.terrain.brick_mm + settings.terrain.sill_mm)

    def slope(direction: Array) -> Array:
        rise = scene.elevation(here + 0.1 * direction) - scene.elevation(here - 0.1 * direction)
        axis = np.array([*direction, float(rise) / 0.2])
        return axis / np.linalg.norm(axis)

    x = slope(forward)
    z = np.cross(x, slope(left))
    z /= np.linalg.norm(z)
    T_world_chassis = np.column_stack([x, np.cross(z, x), z])
    ground = np.array([*here, float(scene.elevation(here))])
    world.reset()
    T = se3.pose(T_world_chassis, ground + (WHEEL_RADIUS_M + clearance_m) * z)
    world.data.joint(PREFIX + "free").qpos = (*T[:3, 3], *se3.to_quat_wxyz(T))
    world.move_movers(START_S)
    world.place_bodies()


def _later(world: World, by_s: float) -> World:
    """Shift everything that depends on time alone."""

    def shifted(motion: Motion) -> Motion:
        return lambda time_s: motion(time_s + by_s)

    brightness = world.scene.brightness
    scene = replace(world.scene, brightness=lambda times_s: brightness(times_s + by_s))
    movers = {name: shifted(motion) for name, motion in world.movers.items()}
    return replace(world, scene=scene, movers=movers)
