"""E5: motion refinement lowers the reprojection error of a blurred turn (thesis 4.3, fig. 4.4)."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import mean_interval
from trials.evaluation.runs import read_map
from trials.execution.jobs import Result, Results
from trials.report.figure import BLUE, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import draw_turn_rate, turn_rate_deg_s
from trials.studies.experiments.variants import UNREFINED
from vo.bundle_adjustment.adjust import refine_motion
from vo.config import THESIS
from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.contract.readers import open_sequence
from vo.runner import companion

PEAK = 2.0
"""Ratio to the median above which an error is a peak."""
FAST_DEG_S = 60.0
MIN_POINTS = 6
"""Number of points that a frame must observe."""


@dataclass(frozen=True)
class Reprojection:
    """Mean reprojection error of every frame, pixels; NaN with fewer than MIN_POINTS.

    Attributes:
        before: (N,) with the poses of RANSAC.
        after: (N,) with poses refined on the same, fixed points.
        turn_deg_s: (N,) true turn rate of the camera.
    """

    before: Array
    after: Array
    turn_deg_s: Array

    @property
    def peaks(self) -> Mask:
        """(N,) frames whose error before is above PEAK times the median."""
        return self.before > PEAK * np.nanmedian(self.before)


def _by_seed(results: Results) -> dict[int, Reprojection]:
    return {r.seed: _reprojection(results.at(r, UNREFINED)) for r in results.recordings}


@cache
def _reprojection(result: Result) -> Reprojection:
    """Refine every pose of an unrefined run on the points of its map."""
    rig = open_sequence(result.dataset).rig
    points, tracks = read_map(companion(result.file, "map.ply")), result.tracks
    order = np.argsort(points.ids)
    row = np.searchsorted(points.ids[order], tracks.landmark).clip(max=len(order) - 1)
    known = tracks.inlier & (points.ids[order][row] == tracks.landmark)
    trajectory = result.run.trajectory
    poses = dict(zip(trajectory.timestamps_ns.tolist(), trajectory.T_ref_frame, strict=True))
    before, after = np.full((2, len(result.frames)), np.nan)
    for i, time_ns in enumerate(result.frames.timestamps_ns.tolist()):
        mine = known & (tracks.frame == i)
        if time_ns not in poses or mine.sum() < MIN_POINTS:
            continue
        seen = points.points_odom[order][row[mine]]
        measured = np.column_stack([tracks.pixels[mine], tracks.disparity_px[mine]])
        sigma = np.full(measured.shape, THESIS.refinement.sigma_px)
        refined = refine_motion(poses[time_ns], seen, measured, sigma, rig, THESIS.refinement)
        for errors, T in ((before, poses[time_ns]), (after, refined.T_world_cam)):
            pixels = rig.project(se3.transform(se3.inverse(T), seen))[:, :2]
            errors[i] = np.mean(np.linalg.norm(pixels - tracks.pixels[mine], axis=1))
    return Reprojection(before, after, turn_rate_deg_s(result))


def _conclude(results: Results) -> Finding:
    before, after, turn_deg_s, peaks = (
        np.concatenate([getattr(x, name) for x in _by_seed(results).values()])
        for name in ("before", "after", "turn_deg_s", "peaks")
    )
    if not peaks.any():
        return Verdict.FAILS, _without_peaks(before, after, turn_deg_s > FAST_DEG_S)
    removed = after[peaks] < PEAK * np.nanmedian(after[~peaks])
    gain = mean_interval(before[peaks] / after[peaks])
    return Verdict.of(gain.value > 1, removed.mean() > 0.5), (
        f"Of {len(removed)} frames whose error is more than {PEAK:g} times the median, refinement "
        f"of the motion alone brings {100 * removed.mean():.0f} % below that limit; it divides "
        f"their error by {gain.text(1)}. It cannot correct the matches, which have errors on a "
        "blurred frame."
    )


def _without_peaks(before: Array, after: Array, fast: Mask) -> str:
    return (
        "There is no peak: the threshold of RANSAC limits the errors of inliers, and of "
        f"{fast.sum()} frames that turn by more than {FAST_DEG_S:g} °/s "
        f"{np.isnan(before[fast]).sum()} have too few landmarks. In all other frames refinement "
        "of the motion lowers the error of the inliers, "
        f"from {np.nanmean(before):.2f} to {np.nanmean(after):.2f} px."
    )


def _table(results: Results) -> Rows:
    def mean_px(errors: Array) -> str:
        return f"{np.nanmean(errors):.2f}" if len(errors) else "–"

    for seed, x in _by_seed(results).items():
        rate = f"{np.median(x.turn_deg_s[x.peaks]):.0f}" if x.peaks.any() else "–"
        yield {
            "seed": str(seed),
            "peaks, frames": str(x.peaks.sum()),
            "elsewhere before, px": mean_px(x.before[~x.peaks]),
            "elsewhere after, px": mean_px(x.after[~x.peaks]),
            "peaks before, px": mean_px(x.before[x.peaks]),
            "peaks after, px": mean_px(x.after[x.peaks]),
            "turn rate at peaks, °/s": rate,
        }


def _data(results: Results) -> Data:
    return {
        f"seed {k}": {"before, px": x.before, "after, px": x.after, "turn rate, °/s": x.turn_deg_s}
        for k, x in _by_seed(results).items()
    }


def _draw(figure: Figure, results: Results) -> None:
    found = _by_seed(results)
    seed, shown = max(found.items(), key=lambda item: np.nanmax(item[1].before, initial=0))
    panel = figure.subplots()
    top_deg_s = 2.5 * max(shown.turn_deg_s.max(), 1)
    draw_turn_rate(panel, np.arange(len(shown.turn_deg_s)), shown.turn_deg_s, top_deg_s)
    panel.plot(shown.before, color=BLUE, lw=1.0, label="before refinement of the pose")
    panel.plot(shown.after, color=RED, lw=1.0, label="after")
    panel.set_ylim(bottom=0)
    panel.legend(loc="lower right")
    tidy(panel, "frame", "mean reprojection error, px", f"turntable, seed {seed}")


E5 = Experiment(
    id="E5",
    title="Reprojection error before and after motion refinement",
    claim="Motion refinement removes a peak of the reprojection error at a blurred, fast turn.",
    source="section 4.3, figure 4.4",
    setup="The thesis preset without refinement on turntable (turns of up to 120 °/s, shutter "
    "open for 18 ms); then every pose is refined on the points of its map, as in figure 4.4.",
    caption="Mean reprojection error of every frame before and after refinement of the motion on "
    "fixed points; grey: turn rate of the camera.",
    size_in=(9.0, 3.2),
    recordings=lambda scale: scale.recordings(["turntable"], 3),
    variants=(UNREFINED,),
    steps=Steps(_conclude, _table, _draw, _data),
)
