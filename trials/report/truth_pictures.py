"""Pictures of truth beyond labels: flow between frames, tracks, boxes, clouds, occupancy."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.preview.colours import rgb_of
from sim.preview.label_plates import draw_flow, draw_visibility, show
from sim.truth.boxes import Box
from sim.truth.clouds import PointCloud
from sim.truth.occupancy import Occupancy
from sim.truth.tracks import Tracks
from trials.report.figure import GREY, Draw, make_figure, tidy
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig

PANEL_IN = 4.6
"""Width of a panel with an image."""
HEADING_IN = 0.4
"""Height of the title and key above it."""
TAIL_FRAMES = 12
"""Number of earlier frames in which the path of a tracked point is drawn."""
GROUND_COLOURS = np.array([(205, 209, 214), (255, 255, 255), (43, 48, 54)], np.uint8)
"""Colours of unknown, free and occupied cells."""
CLOUD_PX = 500
"""Pixels along the longer side of a cloud from above."""


def flow_picture(flow: Array, covisibility: Array, image: Image, to: str) -> Figure:
    """Draw flow (H, W, 2), and what the other frame, whose name is given, does not show."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        draw_visibility(left, covisibility, rgb_of(image), "covisibility", f"hidden in {to}")
        draw_flow(right, flow, to)

    return _figure_of_images(image, 2, draw)


def tracks_picture(tracks: Tracks, images: Sequence[Image], frames: Sequence[int]) -> Figure:
    """Draw tracks on the images of some frames: a disc where visible, a ring where not.

    The colours are by place in the query frame; lines lead through the frames before.
    """
    hue = np.argsort(np.argsort(tracks.queries @ [0, 1.0, 1e-3])) / max(1, len(tracks.queries))
    colours = _rainbow(hue)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(frames), squeeze=False)[0]
        for panel, frame, image in zip(panels, frames, images, strict=True):
            seen = int((~tracks.occluded[:, frame]).sum())
            show(panel, rgb_of(image), f"frame {frame}", f"{seen} of {len(hue)} points visible")
            tail = slice(max(0, frame - TAIL_FRAMES), frame + 1)
            for path, colour in zip(tracks.pixels[:, tail], colours, strict=True):
                panel.plot(*path.T, color=colour, lw=0.7, alpha=0.8)
            for occluded, face in ((False, colours), (True, "none")):
                chosen = tracks.occluded[:, frame] == occluded
                fill = face if isinstance(face, str) else face[chosen]
                place, edge = tracks.pixels[chosen, frame], colours[chosen]
                panel.scatter(*place.T, s=11, facecolors=fill, edgecolors=edge, linewidths=0.8)
            _limit(panel, image)

    return _figure_of_images(images[0], len(frames), draw)


def boxes_picture(boxes: Sequence[Box], image: Image, rig: StereoRig) -> Figure:
    """Draw the boxes of a frame on its image: in the image, and the edges of those in the world."""
    shown = [x for x in boxes if x.kind != "ground"]
    colours = _rainbow(np.arange(len(shown)) / max(1, len(shown)))

    def draw(figure: Figure) -> None:
        flat, solid = figure.subplots(1, 2)
        show(flat, rgb_of(image), "boxes in the image", "modal, and amodal dashed")
        show(solid, rgb_of(image), "boxes in the world", f"{len(shown)} objects")
        for box, colour in zip(shown, colours, strict=True):
            for edges, style in ((box.modal_px, "-"), (box.amodal_px, ":")):
                low, high = edges[:2], edges[2:]
                corners = [low, (high[0], low[1]), high, (low[0], high[1]), low]
                flat.plot(*np.array(corners).T, style, color=colour, lw=1.2)
            at = np.clip(box.modal_px[:2], 0, None)
            flat.text(*at, box.name, fontsize=6, color=colour, va="bottom", clip_on=True)
            corners = box.corners_cam
            for a, b in combinations(range(8), 2):
                if bin(a ^ b).count("1") == 1 and (corners[[a, b], 2] > 0.05).all():
                    solid.plot(*rig.project(corners[[a, b]])[:, :2].T, color=colour, lw=1.2)
        _limit(flat, image)
        _limit(solid, image)

    return _figure_of_images(image, 2, draw)


def cloud_picture(cloud: PointCloud, T_world_cam: Array) -> Figure:
    """Draw a cloud from above, the highest points on top, with the path of the cameras."""
    points = cloud.points_world
    low, high = (np.percentile(points, q, axis=0) for q in (0.1, 99.9))
    side_m = max(float((high - low)[:2].max()), 0.1) / CLOUD_PX
    size = (np.floor((high - low)[:2] / side_m) + 1).astype(int)
    order = np.argsort(points[:, 2])
    cells = np.floor((points[order, :2] - low[:2]) / side_m).astype(int)
    inside = ((cells >= 0) & (cells < size)).all(axis=1)
    picture = np.full((size[1], size[0], 3), 255, np.uint8)
    picture[cells[inside, 1], cells[inside, 0]] = cloud.colours[order][inside]

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        extent = (low[0], high[0], low[1], high[1])
        panel.imshow(picture, origin="lower", extent=extent)
        panel.plot(*T_world_cam[:, :2, 3].T, color="#c8401e", lw=1.5)
        tidy(panel, "x, m", "y, m", f"{len(points):,} points from above, and the camera's path")
        panel.grid(False)

    return make_figure(_size_in(picture), draw)


def occupancy_picture(ground: Occupancy, voxels: Occupancy, T_world_cam: Array) -> Figure:
    """Draw cells of the ground, and voxels in a horizontal and a vertical cut by the first pose."""
    _, y, z = T_world_cam[0, :3, 3]
    row, layer = (
        int(np.clip((at - voxels.origin_m[axis]) / voxels.resolution_m, 0, count - 1))
        for at, axis, count in ((y, 1, voxels.states.shape[1]), (z, 2, voxels.states.shape[0]))
    )
    cuts = (
        (ground.states, ground, (0, 1), "cells of the ground"),
        (voxels.states[layer], voxels, (0, 1), f"voxels at z = {z:.2f} m"),
        (voxels.states[:, row], voxels, (0, 2), f"voxels at y = {y:.2f} m"),
    )

    def draw(figure: Figure) -> None:
        panels = figure.subplot_mosaic("AB;CC", height_ratios=(4, 1)).values()
        for panel, (states, grid, axes, title) in zip(panels, cuts, strict=True):
            low = grid.origin_m[list(axes)]
            high = low + np.array(states.shape[::-1]) * grid.resolution_m
            colours = GROUND_COLOURS[np.digitize(states, (0, 1))]
            extent = (low[0], high[0], low[1], high[1])
            panel.imshow(colours, origin="lower", extent=extent, interpolation="nearest")
            tidy(panel, "x, m", f"{'xyz'[axes[1]]}, m", title)
            panel.grid(False)
            panel.plot(*T_world_cam[:, axes, 3].T, color="#c8401e", lw=1.2)
        about = "white free, dark occupied, grey unknown; red the camera's path"
        figure.suptitle(about, fontsize=8.5, color=GREY, x=0.01, ha="left")

    height, width = ground.states.shape
    return make_figure((11.0, min(14.0, 5.0 * height / width + 2.6)), draw)


def _figure_of_images(image: Image, count: int, draw: Draw) -> Figure:
    """Make a figure of panels with images of one size in a row, with room for headings."""
    height, width = image.shape[:2]
    height_in = PANEL_IN * height / width + HEADING_IN

    def draw_below_headings(figure: Figure) -> None:
        draw(figure)
        rect = (0, 0, 1, 1 - HEADING_IN / height_in)
        figure.set_layout_engine("constrained", rect=rect, h_pad=0.0, w_pad=0.04)

    return make_figure((PANEL_IN * count, height_in), draw_below_headings)


def _limit(panel: Axes, image: Image) -> None:
    height, width = image.shape[:2]
    panel.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))


def _rainbow(share: Array) -> Array:
    """Return colours (N, 3) around the wheel, 0 to 1."""
    turns = 2 * np.pi * (share[:, None] + np.array([0, 1 / 3, 2 / 3]))
    return 0.55 + 0.4 * np.cos(turns)


def _size_in(picture: Array) -> tuple[float, float]:
    height, width = picture.shape[:2]
    scale = 7.0 / max(height, width)
    return max(3.0, width * scale) + 0.6, max(2.0, height * scale) + 0.6
