"""One plate for each label: its colours, what they mean in a line above it, and its numbers."""

from collections.abc import Sequence

import cv2
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.offsetbox import AnchoredOffsetbox, DrawingArea, HPacker, TextArea, VPacker
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from scenes.scene import Kind
from sim.labels.annotate import Annotation
from sim.labels.visibility import Occlusion
from sim.preview.colours import (
    KINDS,
    RGB,
    SEEN,
    class_colours,
    depth_scale,
    flow_colours,
    flow_wheel,
    normal_colours,
    object_colours,
    round_up,
    seen_colours,
)
from vo.contract.arrays import Array, Image

INK, FAINT = "#2b3036", "#6d747c"
Key = Sequence[tuple[RGB, str]]
"""Colours and what they mean."""

NAMES_MAX = 9
"""Objects that are named on the plate."""
NAMED_SHARE = 0.004
"""Of the picture: smaller objects go without name."""
MARKS = 4
"""Depths in the key."""
NORMALS: Key = (
    ((255, 128, 128), "right"),
    ((128, 255, 128), "up"),
    ((128, 128, 255), "towards the camera"),
)


def show(axes: Axes, image: Image, title: str, about: str = "", key: Key = ()) -> None:
    """Show a picture with a bold title, a few words and a key above it."""
    axes.imshow(image, interpolation="antialiased")
    axes.set_axis_off()
    parts: list[Artist] = [
        TextArea(title, textprops={"fontsize": 9, "color": INK, "weight": "bold"})
    ]
    if about:
        parts.append(TextArea(about, textprops={"fontsize": 8.5, "color": FAINT}))
    lines: list[Artist] = [HPacker(children=parts, align="baseline", pad=0, sep=6)]
    if key:
        entries: list[Artist] = [part for colour, text in key for part in _entry(colour, text)]
        lines.append(HPacker(children=entries, align="center", pad=0, sep=3.5))
    box = VPacker(children=lines, align="left", pad=0, sep=2)
    strip = AnchoredOffsetbox(
        "lower left",
        child=box,
        pad=0,
        borderpad=0.12,
        frameon=False,
        bbox_to_anchor=(0, 1.005),
        bbox_transform=axes.transAxes,
    )
    axes.add_artist(strip)


def _entry(colour: RGB, text: str) -> tuple[DrawingArea, TextArea]:
    square = DrawingArea(8, 8)
    face = [c / 255 for c in colour]
    square.add_artist(Rectangle((0, 0), 8, 8, facecolor=face, edgecolor=FAINT, linewidth=0.4))
    return square, TextArea(text, textprops={"fontsize": 7.2, "color": FAINT})


def draw_depth(axes: Axes, annotation: Annotation) -> None:
    """Colour the logarithm of depth; the key gives the disparity that belongs to it."""
    scale = depth_scale(annotation.depth)
    rig = annotation.annotator.rig
    key = [
        (scale.colour(m), f"{m:g} m · {_short(rig.f_px * rig.baseline_m / m)}")
        for m in scale.marks(MARKS)
    ]
    show(axes, scale.colours(annotation.depth), "depth", "and disparity in px", key)


def draw_objects(axes: Axes, annotation: Annotation) -> None:
    """Colour the objects and name those that have room for it."""
    objects = annotation.segmentation
    rgb, numbers = object_colours(objects)
    show(axes, rgb, "objects", f"{len(numbers)} in view")
    taken = np.zeros(objects.shape, bool)
    for number in numbers[:NAMES_MAX]:
        name = annotation.annotator.things[number - 1].name
        place = _room_for(name, objects == number, taken)
        if place is None:
            continue
        text = axes.text(*place, name, fontsize=6.5, color="white", ha="center", va="center")
        text.set_path_effects([withStroke(linewidth=1.8, foreground="#000000c0")])


def _room_for(name: str, mask: Array, taken: Array) -> tuple[float, float] | None:
    """Where a name can stand: well inside of its object, in the picture and off other names.

    Args:
        name: The longer, the more room it needs.
        mask: (H, W) the object's pixels.
        taken: (H, W) where names are; the new one is added.

    Returns:
        Pixel (u, v) of its middle; None if there is no room.
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


def draw_classes(axes: Axes, annotation: Annotation) -> None:
    """Colour ground, what stands, what moves and the sky."""
    order = (Kind.GROUND, Kind.STATIC, Kind.MOVING, Kind.SKY)
    key = [(KINDS[kind], kind.name.lower()) for kind in order]
    show(axes, class_colours(annotation.classes), "classes", "", key)


def draw_normals(axes: Axes, annotation: Annotation) -> None:
    """Colour the directions in which surfaces face."""
    show(axes, normal_colours(annotation.normals), "normals", "facing", NORMALS)


def draw_occlusion(axes: Axes, annotation: Annotation, view: Image) -> None:
    """Mark what the right eye does not see."""
    _draw_seen(axes, annotation.occlusion, view, "occlusion", "not seen by the right eye")


def draw_covisibility(axes: Axes, annotation: Annotation, view: Image) -> None:
    """Mark what the next frame does not see."""
    _draw_seen(axes, annotation.covisibility, view, "covisibility", "not seen by the next frame")


def _draw_seen(axes: Axes, codes: Array, view: Image, title: str, about: str) -> None:
    words = {
        Occlusion.HIDDEN: "hidden",
        Occlusion.OUTSIDE: "out of view",
        Occlusion.NOTHING: "no surface",
    }
    key = [(SEEN[code], f"{text} {np.mean(codes == code):.1%}") for code, text in words.items()]
    show(axes, seen_colours(codes, view), title, about, key)


def draw_flow(axes: Axes, annotation: Annotation) -> None:
    """Colour the motion to the next frame; the wheel says which colour is which direction."""
    flow = annotation.flow
    full_px = flow_full_px(flow)
    about = f"to the next frame, full at {_short(full_px)} px"
    show(axes, flow_colours(flow, full_px), "optical flow", about)
    aspect = flow.shape[1] / flow.shape[0]
    wheel = axes.inset_axes((0.985 - 0.2 / aspect, 0.02, 0.2 / aspect, 0.2))
    wheel.imshow(flow_wheel(96))
    wheel.set_axis_off()
    for turn, arrow in enumerate(("→", "↓", "←", "↑")):
        u, v = 47.5 + 33 * np.cos(turn * np.pi / 2), 47.5 + 33 * np.sin(turn * np.pi / 2)
        wheel.text(u, v, arrow, fontsize=7, color=INK, ha="center", va="center")


def flow_full_px(flow: Array) -> float:
    """Round length that nearly all vectors of an (H, W, 2 or more) flow stay below."""
    lengths = np.hypot(flow[..., 0], flow[..., 1])
    known = lengths[np.isfinite(lengths)]
    return round_up(max(float(np.percentile(known, 98)) if known.size else 0.0, 0.1))


def _short(x: float) -> str:
    return f"{x:.0f}" if x >= 9.95 else f"{x:.2g}"
