"""Report of runs on one dataset, as an HTML page."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trials.evaluation.alignment import Alignment, associate, fit
from trials.evaluation.runs import SavedRun
from trials.evaluation.score import score_run
from trials.evaluation.truth import true_trajectory
from trials.report.charts import drift_by_length, error_over_distance, stage_counts, stage_timings
from trials.report.html import write_html
from trials.report.stills import TRAIL_FRAMES, stills
from trials.report.trajectory_plot import plot_trajectories, read_scene_map
from vo.contract.readers import open_sequence


def write_report(dataset: Path, runs: Sequence[SavedRun], out: Path) -> None:
    """Write one HTML file without references to other files or the network.

    Args:
        dataset: Folder with truth.
        runs: At least one; the first is shown in detail.
        out: File to write.

    Raises:
        DatasetError: If the dataset is unreadable or has no ground truth.
        TrajectoryError: If a run and the truth share fewer than two times.
    """
    sequence, truth = open_sequence(dataset), true_trajectory(dataset)
    runs = _distinct(runs)
    main, table = runs[0], runs[0].frames
    scores = [score_run(truth, run, len(sequence)) for run in runs]
    pairs = {run.estimator: associate(truth, run.trajectory) for run in runs}
    aligned = {x: fit(pair, Alignment.FIRST_POSE).map(pair.T_odom_cam) for x, pair in pairs.items()}
    charts = [error_over_distance(pairs)]
    if scores[0].segments:
        charts.append(drift_by_length(scores))
    if table is not None and table.counts:
        charts.append(stage_counts(table))
    if table is not None and table.timings_ms:
        charts.append(stage_timings(table))
    write_html(
        out,
        "page.html.j2",
        name=sequence.name,
        duration_s=(sequence.timestamps_ns[-1] - sequence.timestamps_ns[0]) / 1e9,
        scores=scores,
        main=scores[0],
        trajectories=plot_trajectories(
            pairs[main.estimator].T_world_cam,
            {name: T_world_cam[:, :3, 3] for name, T_world_cam in aligned.items()},
            read_scene_map(dataset),
        ),
        charts=charts,
        stills=stills(sequence, main),
        trail_frames=TRAIL_FRAMES,
        records=[(run.estimator, json.dumps(dict(run.about), indent=1)) for run in runs],
    )


def _distinct(runs: Sequence[SavedRun]) -> list[SavedRun]:
    """Add the file name to the names of runs of the same estimator."""
    names = [run.estimator for run in runs]
    return [
        run
        if names.count(run.estimator) == 1
        else replace(run, estimator=f"{run.estimator} ({run.path.stem})")
        for run in runs
    ]
