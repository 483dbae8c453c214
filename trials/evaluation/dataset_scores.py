"""Scores of runs over a dataset, with remarks on what does not fit its ground truth."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trials.evaluation.disparity_errors import disparity_errors
from trials.evaluation.mismatch import Frame, remark_mismatches
from trials.evaluation.runs import SavedRun
from trials.evaluation.score import Score, score_run
from trials.evaluation.truth import true_trajectory
from vo.recordings.readers import read_body_pose, read_frame_times


def score_runs(
    dataset: Path, runs: Sequence[SavedRun], frame: Frame = Frame.CAM, frames: int | None = None
) -> list[Score]:
    """Compare runs, whose poses are those of a frame, with the ground truth of a dataset.

    The number of frames is that of a selection, by default of all frames of the dataset.

    Raises:
        DatasetError: If the dataset is unreadable or has no ground truth.
        TrajectoryError: If a run and the truth share fewer than two times.
    """
    truth, T_body_cam = true_trajectory(dataset), read_body_pose(dataset)
    frames = len(read_frame_times(dataset)) if frames is None else frames
    moved = [run.moved(frame.T_frame_cam(T_body_cam)) for run in runs]
    for run in moved:
        remark_mismatches(truth, run, T_body_cam, frame)
    return [
        replace(score_run(truth, run, frames), disparity=disparity_errors(dataset, run))
        for run in moved
    ]
