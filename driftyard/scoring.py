"""Scores of runs against the ground truth."""

from pathlib import Path

from driftyard.dataset import Dataset, PathLike
from driftyard.estimation import run_of
from driftyard.failures import in_one_family
from trials.evaluation.dataset_scores import score_runs
from trials.evaluation.mismatch import Frame
from trials.evaluation.runs import SavedRun
from trials.evaluation.score import Score
from vo.contract.errors import SettingsError


@in_one_family
def score(dataset: Dataset | PathLike, run: SavedRun | PathLike, *, frame: str = "cam") -> Score:
    """Compare a run with the ground truth of its recording.

    A warning says so if the estimate is in another frame, unit or clock than it claims.

    Args:
        dataset: An open recording, or its folder.
        run: A run, or a trajectory file of any program.
        frame: Frame of the poses in the file: `cam`, the rectified left camera, or `body`.

    Raises:
        DatasetError: If the recording has no ground truth.
        TrajectoryError: If the run cannot be read, or shares fewer than two times with the truth.
        SettingsError: If the frame is neither.

    Example:
        >>> dy.score(ds, "corner_flow.txt").compared == len(ds)
        True
    """
    if frame not in (valid := [x.value for x in Frame]):
        raise SettingsError(f"frame {frame}: expected {' or '.join(valid)}")
    is_open = isinstance(dataset, Dataset)
    folder, frames = (dataset.path, len(dataset)) if is_open else (Path(dataset), None)
    return score_runs(folder, [run_of(run, dataset)], Frame(frame), frames)[0]
