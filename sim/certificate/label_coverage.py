"""Coverage: whether images show what labels know of and nothing else, by drawing both again.

Unlike the other checks, it needs the renderer: it is made at recording, not by verification.
"""

from typing import Any

import numpy as np

from sim.camera.render import StereoRenderer
from sim.world.trip import Trip
from sim.world.world import World

COVERAGE = "coverage"
"""Name of this part of the certificate."""
FRAMES = 8
LIMIT_PX = 6
"""Pixels of both images of a frame that grass blades finer than a pixel may explain."""


def check_coverage(world: World, trip: Trip, renderer: StereoRenderer) -> dict[str, Any]:
    """Draw some frames, evenly spaced, as images and as labels, and compare the depths.

    A pixel of a surface that has no label, or of a label whose surface is not drawn, is wrong.
    Moves the world. Returns the part of the certificate.
    """
    times_ns = trip.timestamps_ns[trip.delivered]
    chosen = np.unique(np.linspace(0, len(times_ns) - 1, FRAMES).astype(int))
    wrong_px: dict[int, int] = {}
    for time_ns in times_ns[chosen].tolist():
        world.place(time_ns * 1e-9, trip.states.at(world.model, time_ns))
        wrong_px[time_ns] = renderer.unlabelled_pixels()
    failed = [time_ns for time_ns, count in wrong_px.items() if count > LIMIT_PX]
    return {
        "about": "pixels of both images whose surface is not that of the labels, in "
        f"{len(chosen)} frames; found when they were rendered, not verified again",
        "unlabelled_max_px": max(wrong_px.values()),
        "limit_px": LIMIT_PX,
        "failed_frames_ns": failed,
        "passed": not failed,
    }
