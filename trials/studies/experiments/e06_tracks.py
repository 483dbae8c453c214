"""E6: the visibility mask, and structure from points with two views (thesis 4.4, fig. 4.5)."""

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import KDTree

from trials.evaluation.intervals import mean_interval
from trials.evaluation.runs import read_map
from trials.execution.jobs import Result, Results, Variant
from trials.report.figure import BLUE, INK, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import lost_text, mean_text
from vo.contract import se3
from vo.contract.arrays import Array
from vo.runner import companion

SCENES = ("office", "brick_court")
LEFT_ONLY, TWO_VIEWS = "refinement.use_disparity=false", "refinement.min_views=2"
THREE_LEFT = Variant("3 views, left image", "thesis", (LEFT_ONLY,))
TWO_LEFT = Variant("2 views, left image", "thesis", (LEFT_ONLY, TWO_VIEWS))
TWO_STEREO = Variant("2 views, stereo", "thesis", (TWO_VIEWS,))
THREE_STEREO = Variant("3 views, stereo", "thesis")
STYLES = {TWO_LEFT: (BLUE, "-"), THREE_LEFT: (RED, "-"), TWO_STEREO: (BLUE, ":"),
          THREE_STEREO: (INK, "--")}  # fmt: skip
"""Variant to the colour and style of its line."""
NEAR_M, FAR_M = 0.1, 50.0
"""Distances from the camera, metres, between which all observed surfaces are."""
FRAMES, ROWS = 60, 240
"""Size of the mask in the figure: the first frames, and a subset of the landmarks."""


def _distances_m(run: Result) -> Array:
    """Return the distance (J,) of every point of a map from the nearest estimated camera."""
    points = read_map(companion(run.file, "map.ply")).points_odom
    cameras = run.run.trajectory.T_ref_frame
    origin = se3.inverse(cameras[0])  # the map may have begun elsewhere
    return KDTree(se3.transform(origin, cameras[:, :3, 3])).query(se3.transform(origin, points))[0]


def _wrong_percent(results: Results, variant: Variant) -> Array:
    """Return the fractions of points closer than NEAR_M and not within FAR_M, %, (2, N)."""
    runs = [_distances_m(x) for x in results.of(variant)]
    return 100 * np.array([(np.mean(d < NEAR_M), np.mean(~(d <= FAR_M))) for d in runs]).T


def _conclude(results: Results) -> Finding:
    two, three = (_wrong_percent(results, v).sum(axis=0).mean() for v in (TWO_LEFT, THREE_LEFT))
    drift = {v: float(np.nanmean(results.drifts(v))) for v in STYLES}
    cost = drift[TWO_LEFT] / drift[THREE_LEFT]
    return Verdict.of(two > three or cost > 1, two > 2 * three and cost > 1.2), (
        f"Refined by the left image alone, as in the thesis, {two:.2f} % of the points of two "
        f"views are closer than {100 * NEAR_M:.0f} cm or farther than {FAR_M:.0f} m ({three:.2f} % "
        f"of those of three views), and the drift is {cost:.1f} times as large. With stereo, where "
        "the refinement also uses the measured disparities, two views have "
        f"{drift[TWO_STEREO] / drift[THREE_STEREO]:.2f} times the drift."
    )


def _table(results: Results) -> Rows:
    for variant in STYLES:
        near, far = (mean_interval(x, 0, 100).text(2) for x in _wrong_percent(results, variant))
        yield {
            "points refined": variant.label,
            f"closer than {100 * NEAR_M:.0f} cm, %": near,
            f"farther than {FAR_M:.0f} m, %": far,
            "drift over 1 m, %": mean_text(results.drifts(variant)),
            "frames lost, %": lost_text(results, variant),
        }


def _data(results: Results) -> Data:
    """Return frame and row of observations in the first frames, and the length of their tracks."""
    tracks = results.at(results.recordings[0], THREE_STEREO).tracks
    ids, length = np.unique(tracks.landmark, return_counts=True)
    length += 1  # the frame of the detection
    early = ids[np.isin(ids, tracks.landmark[tracks.frame < FRAMES])]
    shown = early[:: max(len(early) // ROWS, 1)]
    mine = np.isin(tracks.landmark, shown) & (tracks.frame < FRAMES)
    mask = {
        "frame": tracks.frame[mine],
        "row": np.searchsorted(shown, tracks.landmark[mine]),
        "frames that see the landmark": length[np.searchsorted(ids, tracks.landmark[mine])],
    }
    return {"mask": mask}


def _draw(figure: Figure, results: Results) -> None:
    left, right = figure.subplots(1, 2)
    first = results.recordings[0]
    frame, row, length = _data(results)["mask"].values()
    for mine, colour, label in (
        (length < 3, BLUE, "in two frames or fewer"),
        (length >= 3, RED, "in three or more"),
    ):
        left.plot(frame[mine], row[mine], "s", color=colour, ms=1.6, mew=0)
        left.plot([], [], "s", color=colour, ms=4, label=label)
    left.invert_yaxis()
    left.legend(loc="lower left", title="landmark observed")
    tidy(left, "frame", "landmark", f"{first.scene}, seed {first.seed}")
    edges = np.logspace(-2, 3, 60)
    for variant, (colour, style) in STYLES.items():
        far_m = np.concatenate([_distances_m(x) for x in results.of(variant)])
        share, _ = np.histogram(far_m.clip(edges[0], edges[-1]), edges)
        right.stairs(100 * share / len(far_m), edges, color=colour, ls=style, label=variant.label)
    right.set(xscale="log", yscale="log")
    right.legend()
    tidy(right, "distance of a point from the nearest camera, m", "points, %", "all drives")


E6 = Experiment(
    id="E6",
    title="Track length and the visibility mask",
    claim="Refining points of only two views moves structure to zero or to infinity; using points "
    "of three views and more prevents it.",
    source="section 4.4, figure 4.5",
    setup="The thesis preset on office and brick_court with points of at least two or three "
    "views, refined by the left image alone (eq. 2.29) and by stereo.",
    caption="Left: the visibility mask of the first frames, with a row for each of a subset of the "
    "landmarks in the order of their first view; red: observed in three frames or more, which the "
    "refinement uses. Right: distance of the map points from the camera, all drives.",
    size_in=(9.5, 4.0),
    recordings=lambda scale: scale.recordings(SCENES, 3),
    variants=STYLES,
    steps=Steps(_conclude, _table, _draw, _data),
)
