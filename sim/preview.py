"""A contact sheet: what the rover will see along the route, how deep it is, and the map."""

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from scenes.scene import Scene
from sim.map import TopDownMap, render_map
from sim.render import StereoRenderer
from sim.rover import PREFIX, WHEEL_RADIUS_M
from sim.settings import RecordSettings
from sim.world import START_CLEARANCE_M, START_S, World, build_world
from vo.contract.arrays import Array, Image
from vo.contract.files import encode_png, replacing

STOPS = 6
SETTLE_S = 0.4
HEADING_M = 0.05
"""How far ahead on its way the rover looks for its heading."""
DEPTH_RANGE_M = (0.5, 8.0)
CHASE_PX = (960, 720)
INK, FAINT, ROUTE, PAPER = "#2b3036", "#6d747c", "#ff7a1a", "#f5f4f0"


@dataclass(frozen=True)
class Sights:
    """Everything rendered for a sheet.

    Attributes:
        stops: (STOPS, 2) where the carrier stood, world x, y in metres.
        views: What the left eye saw at each stop, (H, W, 3) RGB.
        depth_m: (H, W) planar depth at the second stop; NaN where nothing is hit.
        chase: The rover at the second stop from behind, (H, W, 3) RGB.
        top_down: The scene from above.
    """

    stops: Array
    views: list[Image]
    depth_m: Array
    chase: Image
    top_down: TopDownMap


def preview(scene: Scene, settings: RecordSettings, out: Path) -> None:
    """Write the contact sheet of a scene as the PNG `out`.

    Raises:
        SettingsError: If the scene has no such route.
        GraphicsError: If there is no GL.
    """
    world = build_world(scene, settings)
    sheet = contact_sheet(world, look_around(world, settings))
    with replacing(out) as partial:
        partial.write_bytes(encode_png(sheet))


def look_around(world: World, settings: RecordSettings) -> Sights:
    """Stand the rover at even spacing along its route and render; moves the world's state."""
    shares = np.arange(STOPS) / STOPS
    stops: list[Array] = []
    views: list[Image] = []
    with StereoRenderer(world, settings.render, color=True) as renderer:
        top_down = render_map(renderer, world.scene.extent_m)
        for share in shares:
            _stand(world, share)
            stops.append(world.T_world_body[:2, 3])
            views.append(renderer.paint()[0])
        _stand(world, shares[1])
        depth_m = renderer.survey().depth_left_m
        chase = renderer.picture(_chase_camera(world), *CHASE_PX)
    return Sights(np.array(stops), views, depth_m, chase, top_down)


def _stand(world: World, share: float) -> None:
    """Bring the carrier that share of its way: the rover, on its springs, or the hands."""
    model, data = world.model, world.data
    mujoco.mj_resetData(model, data)
    if world.arrival_s is not None:
        world.place(START_S + share * (world.arrival_s - START_S), data.qpos.copy())
        return
    s_m = share * world.path.length_m
    here, ahead = world.path.at(s_m), world.path.at(s_m + HEADING_M)
    yaw = math.atan2(*(ahead - here)[::-1])
    data.joint(PREFIX + "free").qpos = (
        *here,
        float(world.scene.elevation(here)) + WHEEL_RADIUS_M + START_CLEARANCE_M,
        *(math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)),
    )
    world.move_movers(START_S)
    mujoco.mj_step(model, data, nstep=round(SETTLE_S / model.opt.timestep))
    world.place_bodies()


def _chase_camera(world: World) -> mujoco.MjvCamera:
    """Look over the rover's shoulder along its heading."""
    T_world_body = world.T_world_body
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat = T_world_body[:3, 3] + 0.3 * T_world_body[:3, 0]
    camera.distance, camera.elevation = 2.1, -24.0
    camera.azimuth = math.degrees(math.atan2(T_world_body[1, 0], T_world_body[0, 0])) + 24.0
    return camera


def contact_sheet(world: World, sights: Sights) -> Image:
    """Compose the sheet, (H, W, 3) RGB: six views, the map, the rover and the depth."""
    figure = Figure(figsize=(16, 9.5), dpi=120, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        3, 4, left=0.012, right=0.988, top=0.895, bottom=0.02, wspace=0.03, hspace=0.10
    )
    for k, view in enumerate(sights.views):
        _show(figure.add_subplot(grid[k // 2, k % 2]), view, f"{k + 1}  left eye")
    _draw_map(figure.add_subplot(grid[:2, 2:]), world, sights)
    _show(figure.add_subplot(grid[2, 2]), sights.chase, "at 2  from behind")
    _draw_depth(figure.add_subplot(grid[2, 3]), world, sights.depth_m)
    figure.text(0.012, 0.962, world.scene.name, fontsize=19, weight="bold", color=INK)
    figure.text(0.012, 0.936, world.scene.tests, fontsize=11, color=FAINT)
    figure.text(0.988, 0.962, _facts(world), fontsize=11, color=FAINT, ha="right")
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def _facts(world: World) -> str:
    rig = world.rig
    hfov = math.degrees(2 * math.atan(rig.width_px / 2 / rig.f_px))
    return (
        f"route {world.path.length_m:.1f} m    {rig.width_px} × {rig.height_px} px    "
        f"{hfov:.0f}° wide    baseline {100 * rig.baseline_m:.1f} cm"
    )


def _show(axes: Axes, image: Image, title: str) -> None:
    axes.imshow(image, interpolation="antialiased")
    axes.set_axis_off()
    axes.set_title(title, fontsize=9, color=FAINT, loc="left", pad=3)


def _draw_depth(axes: Axes, world: World, depth_m: Array) -> None:
    """Colour the logarithm of the depth; a bar names depth and the disparity that belongs to it."""
    near, far = DEPTH_RANGE_M
    share = np.log(np.clip(depth_m, near, far) / near) / math.log(far / near)
    levels = np.nan_to_num(255 * (1 - share), nan=0).astype(np.uint8)
    colours = np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_TURBO), np.uint8)[..., ::-1].copy()
    colours[np.isnan(depth_m)] = 40
    _show(axes, colours, "at 2  depth and disparity")
    height, width = depth_m.shape
    legend = (0.635 * width, 0.045 * height), 0.345 * width, 0.42 * height
    axes.add_patch(Rectangle(*legend, facecolor=INK, alpha=0.72))
    for metres in (0.5, 1, 2, 4, 8):
        level = round(255 * (1 - math.log(metres / near) / math.log(far / near)))
        swatch = cv2.applyColorMap(np.full((1, 1), level, np.uint8), cv2.COLORMAP_TURBO)
        v = height * (0.08 + 0.07 * (math.log2(metres) + 1))
        colour = tuple(float(c) / 255 for c in np.asarray(swatch)[0, 0, ::-1])
        box = Rectangle((0.66 * width, v), 0.05 * width, 0.07 * height, facecolor=colour)
        axes.add_patch(box)
        pixels = world.rig.f_px * world.rig.baseline_m / metres
        label = f"{metres:g} m   {pixels:.0f} px"
        axes.text(0.73 * width, v + 0.052 * height, label, fontsize=8, color="white")


def _draw_map(axes: Axes, world: World, sights: Sights) -> None:
    """Draw route, direction, stops, start and a scale bar over the picture from above."""
    top_down = sights.top_down
    _show(axes, top_down.image, "from above")
    u, v = top_down.pixels(world.path.waypoints).T
    axes.plot(u, v, color="white", linewidth=4.5, alpha=0.75, solid_capstyle="round")
    axes.plot(u, v, color=ROUTE, linewidth=2.2, solid_capstyle="round")
    for k in range(12, len(u) - 2, max(1, len(u) // 14)):
        arrow = {"arrowstyle": "-|>", "color": ROUTE, "linewidth": 1.5, "mutation_scale": 17}
        axes.annotate("", (u[k + 1], v[k + 1]), (u[k], v[k]), arrowprops=arrow)
    for k, (su, sv) in enumerate(top_down.pixels(sights.stops)):
        face = ROUTE if k == 0 else "white"
        axes.plot(su, sv, "o", markersize=15, color=face, markeredgecolor=INK)
        ink = "white" if k == 0 else INK
        axes.text(
            su, sv, str(k + 1), color=ink, fontsize=9, weight="bold", ha="center", va="center"
        )
    start_u, start_v = top_down.pixels(sights.stops[0])
    label = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": "none", "alpha": 0.9}
    axes.text(start_u + 20, start_v - 20, "start", fontsize=9, color=INK, bbox=label)
    height, width = top_down.image.shape[:2]
    metre = 1 / top_down.metres_per_px
    bar = Rectangle((0.03 * width, 0.945 * height), 2 * metre, 0.012 * height, facecolor="white")
    axes.add_patch(bar)
    axes.text(0.03 * width + metre, 0.925 * height, "2 m", fontsize=9, color="white", ha="center")
