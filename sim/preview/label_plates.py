"""One plot for each label: its colours, with title and key above."""

import colorsys
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from scenes.scene import Kind
from sim.labels.annotate import Annotation
from sim.labels.labels import Occlusion
from sim.preview import colours
from vo.contract.arrays import Array, Image

Key = Sequence[tuple[colours.RGB, str]]
"""Colours and their meaning."""

NAMES_MAX = 9
"""Largest number of objects with a name."""
NAMED_SHARE = 0.004
"""Smallest area of an object with a name, as a fraction of the image."""
MARKS = 4
"""Largest number of depths in the key."""
KEY_STYLE: dict[str, Any] = {
    "loc": "lower left",
    "bbox_to_anchor": (0, 1),
    "borderaxespad": 0.3,
    "borderpad": 0,
    "fontsize": 7.2,
    "labelcolor": colours.FAINT,
    "frameon": False,
    "columnspacing": 0.7,
    "handlelength": 1.1,
    "handleheight": 1.1,
    "handletextpad": 0.5,
}
KINDS: dict[Kind, colours.RGB] = {
    Kind.GROUND: (176, 152, 116),
    Kind.STATIC: (84, 122, 166),
    Kind.MOVING: (228, 82, 60),
    Kind.SKY: (200, 222, 236),
}
INVISIBLE: dict[Occlusion, colours.RGB] = {
    Occlusion.HIDDEN: (255, 112, 26),
    Occlusion.OUTSIDE: (54, 140, 255),
    Occlusion.NOTHING: colours.NOTHING,
    Occlusion.EDGE: (255, 221, 64),
}
GOLDEN = 0.618033988749895
CLASSES: Key = [
    (KINDS[kind], kind.name.lower()) for kind in (Kind.GROUND, Kind.STATIC, Kind.MOVING, Kind.SKY)
]
NORMALS: Key = (
    ((255, 128, 128), "right"),
    ((128, 255, 128), "up"),
    ((128, 128, 255), "towards the camera"),
)


def show(axes: Axes, image: Image, title: str, about: str = "", key: Key = ()) -> None:
    """Show an image with a bold title, a short text and a colour key above it."""
    axes.imshow(image, interpolation="antialiased")
    axes.set_axis_off()
    points: dict[str, Any] = {"textcoords": "offset points", "annotation_clip": False}
    place = (0, 1), (0, 13 if key else 3)
    bold = {"fontsize": 9, "color": colours.INK, "weight": "bold"}
    name = axes.annotate(title, *place, xycoords="axes fraction", **bold, **points)
    light: dict[str, Any] = {"fontsize": 8.5, "color": colours.FAINT, "va": "bottom"}
    axes.annotate(about, (1, 0), (6, 0), xycoords=name, **light, **points)
    if key:
        squares = [
            Patch(facecolor=tuple(np.divide(rgb, 255).tolist()), label=text) for rgb, text in key
        ]
        axes.legend(handles=squares, ncols=len(key), **KEY_STYLE)


def draw_labels(cells: Sequence[Axes], annotation: Annotation, view: Image) -> None:
    """Draw depth, objects, classes, normals, occlusion, flow and covisibility, each into a cell."""
    depth, objects, classes, normals, occlusion, flow, covisibility = cells
    _draw_depth(depth, annotation)
    _draw_objects(objects, annotation)
    show(classes, class_colours(annotation.classes), "classes", "", CLASSES)
    show(normals, normal_colours(annotation.normals), "normals", "facing", NORMALS)
    about = "not visible in the right image"
    draw_visibility(occlusion, annotation.occlusion, view, "occlusion", about)
    draw_flow(flow, annotation.flow, "the next frame")
    about = "not visible in the next frame"
    draw_visibility(covisibility, annotation.covisibility, view, "covisibility", about)


def _draw_depth(axes: Axes, annotation: Annotation) -> None:
    """Draw the logarithm of depth; the key gives the disparity of each depth."""
    scale, rig = colours.depth_scale(annotation.depth), annotation.annotator.rig
    marks = scale.marks(MARKS)
    texts = [f"{m:g} m · {_short(rig.f_px * rig.baseline_m / m)}" for m in marks]
    key = list(zip(scale.colours(marks[None])[0].tolist(), texts, strict=True))
    show(axes, scale.colours(annotation.depth), "depth", "and disparity in px", key)


def _draw_objects(axes: Axes, annotation: Annotation) -> None:
    """Draw the objects, with names where there is space."""
    objects = annotation.segmentation
    rgb, numbers = object_colours(objects)
    show(axes, rgb, "objects", f"{len(numbers)} in view")
    taken = np.zeros(objects.shape, bool)
    outline = [withStroke(linewidth=1.8, foreground="#000000c0")]
    style: dict[str, Any] = {"color": "white", "ha": "center", "va": "center"}
    for number in numbers[:NAMES_MAX]:
        name = annotation.annotator.things[number - 1].name
        place = label_position(name, objects == number, taken)
        if place is not None:
            axes.text(*place, name, fontsize=6.5, path_effects=outline, **style)


def object_colours(objects: Array) -> tuple[Image, list[int]]:
    """Colour objects (H, W), with the largest contrast for the largest; 0 is the sky.

    (H, W, 3) RGB, and the numbers that occur, largest area first, without the sky.
    """
    numbers, where, areas = np.unique(objects, return_inverse=True, return_counts=True)
    order = [int(k) for k in np.argsort(-areas) if numbers[k] != 0]
    table = np.zeros((len(numbers), 3), np.uint8)
    table[numbers == 0] = KINDS[Kind.SKY]
    for rank, k in enumerate(order):
        tone = (0.62, 0.92), (0.85, 0.68), (0.38, 0.98), (0.95, 0.9)
        rgb = colorsys.hsv_to_rgb((0.58 + GOLDEN * rank) % 1, *tone[rank % len(tone)])
        table[k] = [round(255 * c) for c in rgb]
    return table[where.reshape(objects.shape)], [int(numbers[k]) for k in order]


def class_colours(classes: Array) -> Image:
    """Colour (H, W) classes as (H, W, 3) RGB."""
    return np.array([KINDS[kind] for kind in Kind], np.uint8)[classes]


def normal_colours(normals: Array) -> Image:
    """Colour (H, W, 3) normals in camera axes: red right, green up, blue towards the camera."""
    channels = normals * np.array([1, -1, -1], np.float32)
    rgb = np.nan_to_num(255 * (channels + 1) / 2, nan=0).astype(np.uint8)
    rgb[np.isnan(normals[..., 0])] = colours.NOTHING
    return rgb


def visibility_colours(codes: Array, view: Image) -> Image:
    """Mark pixels that are not visible in another view on a pale copy of the (H, W, 3) RGB view."""
    grey = np.asarray(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), np.float32)
    rgb = colours.rgb_of((96 + 0.55 * grey).clip(0, 255).astype(np.uint8))
    for code, colour in INVISIBLE.items():
        rgb[codes == code] = colour
    return rgb


def flow_wheel(side_px: int) -> Array:
    """Draw the legend of `flow_colours`, (S, S, 4) RGBA, transparent outside the disc."""
    line = np.linspace(-1, 1, side_px)
    du, dv = np.meshgrid(line, line)
    rgb = colours.flow_colours(np.stack([du, dv], axis=-1), 1.0)
    inside = 255 * (np.hypot(du, dv) <= 1)
    return np.dstack([rgb, inside.astype(np.uint8)])


def label_position(name: str, mask: Array, taken: Array) -> tuple[float, float] | None:
    """Return the pixel (u, v) where a name fits; None if there is no space.

    It lies inside the object's mask (H, W), and off the names in `taken` (H, W), which it joins.
    """
    height, width = mask.shape
    if mask.mean() < NAMED_SHARE:
        return None
    half_u, half_v = round((0.0105 * len(name) + 0.012) * width), round(0.026 * height)
    whole = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((15, 15), np.uint8))
    framed = cv2.copyMakeBorder(whole, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    inside = cv2.distanceTransform(framed, cv2.DIST_L2, 3)[1:-1, 1:-1]
    kernel = np.ones((2 * half_v + 1, 2 * half_u + 1), np.uint8)
    blocked = cv2.dilate(taken.astype(np.uint8), kernel) > 0
    inside[blocked] = 0
    inside[:half_v] = inside[-half_v:] = 0
    inside[:, :half_u] = inside[:, width - half_u :] = 0
    v, u = np.unravel_index(int(np.argmax(inside)), inside.shape)
    if inside[v, u] < 3:
        return None
    taken[v - half_v : v + half_v + 1, u - half_u : u + half_u + 1] = True
    return float(u), float(v)


def draw_visibility(axes: Axes, codes: Array, view: Image, title: str, about: str) -> None:
    """Mark the pixels that are not visible in another view."""
    words = zip(INVISIBLE.items(), ("hidden", "out of view", "no surface", "edge"), strict=True)
    key = [(rgb, f"{text} {np.mean(codes == code):.1%}") for (code, rgb), text in words]
    show(axes, visibility_colours(codes, view), title, about, key)


def draw_flow(axes: Axes, flow: Array, to: str) -> None:
    """Draw the motion to another frame, whose name is given, with a colour wheel of directions.

    The colours of nearly all lengths are below saturation, at a round length.
    """
    lengths = np.hypot(flow[..., 0], flow[..., 1])
    known = lengths[np.isfinite(lengths)]
    full_px = colours.round_up(max(float(np.percentile(known, 98)) if known.size else 0.0, 0.1))
    about = f"to {to}, full at {_short(full_px)} px"
    show(axes, colours.flow_colours(flow, full_px), "optical flow", about)
    aspect = flow.shape[1] / flow.shape[0]
    wheel = axes.inset_axes((0.985 - 0.2 / aspect, 0.02, 0.2 / aspect, 0.2))
    wheel.imshow(flow_wheel(96))
    wheel.set_axis_off()
    for turn, arrow in enumerate(("→", "↓", "←", "↑")):
        u, v = 47.5 + 33 * np.cos(turn * np.pi / 2), 47.5 + 33 * np.sin(turn * np.pi / 2)
        wheel.text(u, v, arrow, fontsize=7, color=colours.INK, ha="center", va="center")


def _short(x: float) -> str:
    return f"{x:.0f}" if x >= 9.95 else f"{x:.2g}"
