"""Errors of the disparities that an estimator measured, against the depth labels of a dataset."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trials.evaluation.runs import SavedRun
from trials.evaluation.truth import TrueWorld
from vo.contract.errors import DatasetError

LARGE_PX = 0.5
"""Error, px, above which a disparity is mostly that of another surface."""

TO_SIGMA = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


@dataclass(frozen=True)
class DisparityErrors:
    """Measured minus true disparity of inliers, at their pixels in the left image.

    Attributes:
        observations: Number of inliers with a disparity and a label.
        median_px: Median error, px.
        sigma_px: Robust standard deviation, by the median absolute deviation, px.
        large_percent: Share of errors above `LARGE_PX`, %.
    """

    observations: int
    median_px: float
    sigma_px: float
    large_percent: float


def disparity_errors(dataset: Path, run: SavedRun) -> DisparityErrors | None:
    """Compare the disparities of a run's inliers with the labels.

    None without tracks or labels of depth, and where no inlier has both.

    Raises:
        DatasetError: If a label is damaged.
    """
    tracks, frames = run.tracks, run.frames
    if tracks is None or frames is None:
        return None
    try:
        world = TrueWorld(dataset)
    except DatasetError:
        return None
    used = tracks.inlier & np.isfinite(tracks.disparity_px)
    found = [
        tracks.disparity_px[here] - world.disparity(time_ns, tracks.pixels[here])
        for frame, time_ns in enumerate(frames.timestamps_ns.tolist())
        if (here := used & (tracks.frame == frame)).any()
    ]
    errors = np.concatenate(found) if found else np.zeros(0)
    errors = errors[np.isfinite(errors)]
    if len(errors) == 0:
        return None
    median = float(np.median(errors))
    sigma = TO_SIGMA * float(np.median(np.abs(errors - median)))
    large = 100 * float(np.mean(np.abs(errors) > LARGE_PX))
    return DisparityErrors(len(errors), median, sigma, large)
