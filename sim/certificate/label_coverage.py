"""Coverage: whether images show what labels know of and nothing else, by drawing both again.

Unlike the other checks, it needs the renderer: it is made at recording, not by verification.
"""

from typing import Any

import cv2
import numpy as np

from sim.camera.render import NO_GEOM, StereoRenderer
from sim.world.trip import Trip
from sim.world.world import World
from vo.contract.arrays import Array, Image, Mask

COVERAGE = "coverage"
"""Name of this part of the certificate."""
FRAMES = 8
LIMIT_PX = 6
"""Pixels of both images of a frame that grass blades finer than a pixel may explain."""
SAME_SHARE = 2e-3
"""Relative difference of the depths of one surface in two drawings."""
SAME_LEVELS = 1
"""Difference of the levels of one colour in two drawings."""
AROUND = np.ones((3, 3), np.uint8)


def check_coverage(world: World, trip: Trip, renderer: StereoRenderer) -> dict[str, Any]:
    """Draw some frames, evenly spaced, as images and as labels, and compare colours and depths.

    Moves the world. Returns the part of the certificate.
    """
    times_ns = trip.timestamps_ns[trip.delivered]
    chosen = np.unique(np.linspace(0, len(times_ns) - 1, FRAMES).astype(int))
    wrong_px: dict[int, int] = {}
    for time_ns in times_ns[chosen].tolist():
        world.place(time_ns * 1e-9, trip.states.at(world.model, time_ns))
        wrong_px[time_ns] = unlabelled_pixels(renderer)
    failed = [time_ns for time_ns, count in wrong_px.items() if count > LIMIT_PX]
    return {
        "about": "pixels of both images whose surface is not that of the labels, or whose colour "
        f"is not the background's where all that is labelled is hidden, in {len(chosen)} frames; "
        "found when they were rendered, not verified again",
        "unlabelled_max_px": max(wrong_px.values()),
        "limit_px": LIMIT_PX,
        "failed_frames_ns": failed,
        "passed": not failed,
    }


def coverage_statement(certificate: dict[str, Any]) -> str:
    """State what of coverage is known of a dataset, from its certificate, in one line."""
    if COVERAGE not in certificate:
        return "coverage: not checked at recording, whether labels know of all that images show"
    found = certificate[COVERAGE]["unlabelled_max_px"]
    return (
        f"coverage: checked at recording, not again: at most {found} px of a pair show what labels "
        "do not, or less"
    )


def unlabelled_pixels(renderer: StereoRenderer) -> int:
    """Count the pixels of both cameras at which images show what labels do not, or less.

    The depth of what images draw, drawn once more as labels are, must be that of the labels. With
    all hidden that labels cover, by object and by pixel, only the colours of the background may
    remain: the sky alone, which no light or shadow changes.
    """
    labels, images = renderer.render_geometry(), renderer.render_drawn_geometry()
    cameras = (
        (labels.depth_left_m, images.depth_left_m, images.geoms_left),
        (labels.depth_right_m, images.depth_right_m, images.geoms_right),
    )
    count = 0
    for (label_m, image_m, objects), colours in zip(
        cameras, zip(*renderer.render_layers(), strict=True), strict=True
    ):
        image, remaining, background = colours
        bare = cv2.erode(np.isnan(label_m).astype(np.uint8), AROUND) > 0
        wrong = contradictions(label_m, image_m) | (~np.isnan(image_m) & (objects == NO_GEOM))
        wrong |= _differ(remaining, background) | (_differ(image, background) & bare)
        count += int(wrong.sum())
    return count


def contradictions(label_m: Array, image_m: Array) -> Mask:
    """Return where the depth (H, W) of one drawing is not that of another, nor beside an outline.

    Both are NaN without a surface. A pixel may show what the other drawing shows in one of the
    pixels around it.
    """
    label, image = (np.nan_to_num(1 / x, nan=0.0) for x in (label_m, image_m))
    low, high = cv2.erode(label, AROUND), cv2.dilate(label, AROUND)
    return (image < low * (1 - SAME_SHARE)) | (image > high * (1 + SAME_SHARE) + 1e-6)


def _differ(image: Image, other: Image) -> Mask:
    """Return where colours (H, W, 4) differ."""
    return cv2.absdiff(image, other)[..., :3].max(axis=-1) > SAME_LEVELS
