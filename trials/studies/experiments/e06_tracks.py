"""E6: the visibility mask, and structure that two-view points ruin (thesis 4.4, fig. 4.5)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import mean_interval
from trials.evaluation.runs import read_map
from trials.execution.jobs import Job, Result, Results, Variant, jobs_of
from trials.report.figure import BLUE, INK, RED, tidy
from trials.studies.experiments.experiment import Experiment, Findings, Scale, TableOf, Verdict
from trials.studies.experiments.measures import track_lengths
from vo.contract import se3
from vo.runner import companion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENES = ("office", "brick_court")
ONE_EYE = "refinement.use_disparity=false"
THREE_MONO = Variant("3 views, one eye", "thesis", (ONE_EYE,))
TWO_MONO = Variant("2 views, one eye", "thesis", (ONE_EYE, "refinement.min_views=2"))
TWO_STEREO = Variant("2 views, both eyes", "thesis", ("refinement.min_views=2",))
THREE_STEREO = Variant("3 views, both eyes", "thesis")
VARIANTS = (TWO_MONO, THREE_MONO, TWO_STEREO, THREE_STEREO)
NEAR_M, FAR_M = 0.1, 50.0
"""No point that the rover sees is closer to its camera, or farther."""
FRAMES, ROWS = 60, 240
"""Of the mask that is drawn: its first frames, and so many landmarks spread over theirs."""


def jobs(scale: Scale) -> Sequence[Job]:
    """Points of at least two or three views, refined by the left eye alone and by both."""
    return jobs_of(scale.recordings(SCENES, 3), VARIANTS)


def distances_m(run: Result) -> np.ndarray:
    """Distance (J,) of every point of a run's map from the nearest estimated camera."""
    from scipy.spatial import cKDTree

    points = read_map(companion(run.file, "map.ply")).points_odom
    cameras = run.run.trajectory.T_ref_frame
    origin = se3.inverse(cameras[0])  # the map may have begun elsewhere
    return cKDTree(se3.transform(origin, cameras[:, :3, 3])).query(se3.transform(origin, points))[0]


def analyse(results: Results) -> Findings:
    """Count points that collapsed or fled, and what they cost."""
    rows: list[tuple[str, ...]] = []
    ruined: dict[str, float] = {}
    drift: dict[str, float] = {}
    for variant in VARIANTS:
        far = [distances_m(x) for x in results.of(variant)]
        near_share = np.array([100 * np.mean(d < NEAR_M) for d in far])
        far_share = np.array([100 * np.mean(~(d <= FAR_M)) for d in far])
        ruined[variant.label] = float(np.mean(near_share + far_share))
        drift[variant.label] = float(np.nanmean(results.drifts(variant)))
        rows.append(
            (
                variant.label,
                mean_interval(near_share, least=0, most=100).text(2),
                mean_interval(far_share, least=0, most=100).text(2),
                mean_interval(results.drifts(variant), least=0).text(3),
                f"{100 * np.mean([x.lost_share for x in results.of(variant)]):.1f}",
            )
        )
    two, three = ruined[TWO_MONO.label], ruined[THREE_MONO.label]
    cost = drift[TWO_MONO.label] / drift[THREE_MONO.label]
    stereo = drift[TWO_STEREO.label] / drift[THREE_STEREO.label]
    verdict = Verdict.FAILS
    if two > three or cost > 1:
        verdict = Verdict.HOLDS if two > 2 * three and cost > 1.2 else Verdict.PARTLY
    return Findings(
        verdict,
        f"Refined by one eye, as in the thesis, points of two views leave {two:.2f} % of the map "
        f"closer than {100 * NEAR_M:.0f} cm or farther than {FAR_M:.0f} m, and {cost:.1f} times "
        f"the drift of points of three views ({three:.2f} %). Where the refinement also holds the "
        f"disparities to what was measured, two views cost {stereo:.2f} times the drift.",
        TableOf(
            (
                "points refined",
                f"closer than {100 * NEAR_M:.0f} cm, %",
                f"farther than {FAR_M:.0f} m, %",
                "drift over 1 m, %",
                "frames lost, %",
            ),
            tuple(rows),
        ),
        "Left: the visibility mask of the first frames, one row for each of some landmarks in the "
        "order of their first view; red: seen in three frames or more, which the refinement takes. "
        "Right: distance of the map's points from the camera, all drives.",
        lambda figure: _draw(figure, results),
        {"mask": _mask(results.at(results.recordings[0], THREE_STEREO))},
    )


def _mask(run: Result) -> dict[str, np.ndarray]:
    """Frame and row of observations in the first frames, and the length of their tracks."""
    tracks = run.tracks
    ids = np.unique(tracks.landmark)
    length = track_lengths(tracks.landmark) + 1  # and the frame in which it was found
    early = ids[np.isin(ids, tracks.landmark[tracks.frame < FRAMES])]
    shown = early[:: max(len(early) // ROWS, 1)]
    mine = np.isin(tracks.landmark, shown) & (tracks.frame < FRAMES)
    return {
        "frame": tracks.frame[mine],
        "row": np.searchsorted(shown, tracks.landmark[mine]),
        "frames that see the landmark": length[np.searchsorted(ids, tracks.landmark[mine])],
    }


def _draw(figure: "Figure", results: Results) -> None:
    left, right = figure.subplots(1, 2)
    first = results.recordings[0]
    frame, row, length = _mask(results.at(first, THREE_STEREO)).values()
    for mine, colour, label in (
        (length < 3, BLUE, "in two frames or fewer"),
        (length >= 3, RED, "in three or more"),
    ):
        left.plot(frame[mine], row[mine], "s", color=colour, ms=1.6, mew=0)
        left.plot([], [], "s", color=colour, ms=4, label=label)
    left.invert_yaxis()
    left.legend(fontsize=8, frameon=False, loc="lower left", title="landmark seen",
                title_fontsize=8)  # fmt: skip
    tidy(left, "frame", "landmark", f"{first.scene}, seed {first.seed}")
    edges = np.logspace(-2, 3, 60)
    for variant, colour, style in zip(
        VARIANTS, (BLUE, RED, BLUE, INK), ("-", "-", ":", "--"), strict=True
    ):
        far = np.concatenate([distances_m(x) for x in results.of(variant)])
        share, _ = np.histogram(far.clip(edges[0], edges[-1]), edges)
        right.stairs(100 * share / len(far), edges, color=colour, ls=style, label=variant.label)
    right.set_xscale("log")
    right.set_yscale("log")
    right.legend(fontsize=8, frameon=False)
    tidy(right, "distance of a point from the nearest camera, m", "points, %", "all drives")


EXPERIMENT = Experiment(
    id="E6",
    title="Track length and the visibility mask",
    claim="Refining points of only two views collapses structure to zero or throws it to "
    "infinity; taking points of three views and more prevents it.",
    source="section 4.4, figure 4.5",
    setup="The thesis preset on office and brick_court with points of at least two or three "
    "views, refined by the left image alone (eq. 2.29) and by both eyes.",
    size_in=(9.5, 4.0),
    jobs=jobs,
    analyse=analyse,
)
