"""How far the limits of diagnosis and relocalization are from what images show.

    python tests/fingerprints.py make after
    python tests/threshold_margins.py after/data/*

Prints, for datasets of several scenes, the darkest and the blankest image, and by how much more
features have a disparity with the images exchanged, as they are and swapped. Then, for several
numbers of landmarks that must confirm a relocalization, how often a view finds itself in the map
that the estimator had some frames before, and how often in the map of another scene, where it never
was. Decision 25 shows the figures.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.sequence import StereoFrame
from vo.hooks import NO_HOOKS
from vo.map.frame import View
from vo.map.local_map import LocalMap
from vo.mapping import relocalization
from vo.odometry import StereoOdometry
from vo.recordings.readers import open_sequence
from vo.stereo.dense import DenseStereo
from vo.stereo.sparse import measure_disparities
from vo.tracking.diagnostics import LIMITS
from vo.tracking.frontend import Frontend

MAPPED_FRAMES, LATER_FRAMES = 30, (5, 10, 15)
CONFIRMING = (10, 20, 40, 80)


def views_of(folder: Path) -> tuple[list[View], LocalMap, list[View]]:
    """Views of a tenth of the frames, the map after some, and views of later frames."""
    sequence = open_sequence(folder)
    frontend, estimator = Frontend(sequence.rig, OdometrySettings()), StereoOdometry(sequence.rig)
    frames = list(sequence)
    for frame in frames[:MAPPED_FRAMES]:
        estimator.track(frame)
    later = [frames[MAPPED_FRAMES + k] for k in LATER_FRAMES]
    seen, found = (
        [frontend.process(x, 0.0, False, NO_HOOKS, Clock()) for x in some]
        for some in (frames[::10], later)
    )
    return seen, estimator.state.map, found


def exchanged_ratio(view: View, swapped: bool) -> float:
    """Features with a disparity after an exchange of the images, to those before it."""
    frame, settings = view.frame, view.settings.stereo
    left, right = (frame.right, frame.left) if swapped else (frame.left, frame.right)
    counts = [
        measure_disparities(
            StereoFrame(frame.timestamp_ns, *pair),
            DenseStereo(settings)(*pair),
            view.features[: LIMITS.probes],
            settings,
        ).known.sum()
        for pair in ((left, right), (right, left))
    ]
    return float(counts[1] / max(counts[0], 1))


def found_ratio(tries: Iterator[tuple[LocalMap, View]], confirming: int) -> str:
    """Views that find a pose in a map, and all."""
    limits = relocalization.LIMITS
    relocalization.LIMITS = replace(limits, confirming_inliers=confirming)
    rng = np.random.default_rng(0)
    found = [relocalization.relocalize(*each, rng) is not None for each in tries]
    relocalization.LIMITS = limits
    return f"{sum(found)} of {len(found)}"


def main(folders: list[Path]) -> None:
    """Print both tables."""
    data = {folder.name: views_of(folder) for folder in folders}
    print(f"{'dataset':14}{'darkest':>9}{'blankest':>9}{'ratio as is':>13}{'ratio swapped':>15}")
    for name, (views, _, _) in data.items():
        images = [image for view in views for image in (view.frame.left, view.frame.right)]
        dark, blank = min(x.mean() for x in images), min(x.std() for x in images)
        most = max(exchanged_ratio(view, swapped=False) for view in views)
        least = min(exchanged_ratio(view, swapped=True) for view in views)
        print(f"{name:14}{dark:9.1f}{blank:9.1f}{most:13.2f}{least:15.1f}")
    for confirming in CONFIRMING:
        own = ((local_map, view) for _, local_map, views in data.values() for view in views)
        others = (
            (local_map, view)
            for name, (_, local_map, _) in data.items()
            for other, (_, _, views) in data.items()
            for view in views
            if other != name
        )
        print(
            f"{confirming} landmarks: in its own map {found_ratio(own, confirming)}, "
            f"in another {found_ratio(others, confirming)}"
        )


if __name__ == "__main__":
    main([Path(x) for x in sys.argv[1:]])
