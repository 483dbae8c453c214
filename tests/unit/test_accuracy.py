"""The statistics behind `make accuracy`."""

from pathlib import Path

import numpy as np
import pytest

from scenes import SCENES
from trials.accuracy import bootstrap_interval, chosen_scenes, summary_table
from trials.drives import fingerprint
from trials.runs import SavedRun
from trials.score import score_run
from vo.contract.errors import SettingsError
from vo.contract.trajectory import Trajectory


def test_interval_of_equal_drives_is_a_point():
    assert bootstrap_interval(np.full(5, 0.07)) == (0.07, 0.07)


def test_interval_lies_within_the_drives_and_holds_their_median():
    values = np.array([0.05, 0.09, 0.06, 0.11, 0.07])
    low, high = bootstrap_interval(values)
    assert values.min() <= low <= np.median(values) <= high <= values.max()


@pytest.mark.parametrize("drives", [25, 100])
def test_interval_covers_the_true_median_as_often_as_it_says(drives):
    rng = np.random.default_rng(drives)
    covered = 0
    for _ in range(60):
        low, high = bootstrap_interval(rng.exponential(size=drives))
        covered += low <= np.log(2) <= high  # the median of an exponential distribution
    assert 50 <= covered < 60


def test_fingerprint_is_of_the_sources_alone():
    assert fingerprint() == fingerprint()
    assert len(fingerprint()) == 12


def drive(scale):
    """The score of a straight drive of three metres whose estimate is so much too long."""
    times = 10**8 * np.arange(61)
    T = np.tile(np.eye(4), (61, 1, 1))
    T[:, 2, 3] = np.linspace(0, 3, 61)
    truth = Trajectory(times, T)
    estimated = T.copy()
    estimated[:, 2, 3] *= scale
    return truth, Trajectory(times, estimated)


def scored(name, scale):
    truth, estimated = drive(scale)
    return score_run(truth, SavedRun(Path("x.txt"), name, estimated), 65)


def test_summary_sets_medians_beside_each_other():
    """Three drives: scales wrong by 1, 2 and 6 per mille, the baseline's by 4 each time."""
    scores = [scored("driftyard", 1 + x) for x in (0.001, 0.006, 0.002)]
    scores += [scored("corner_flow", 1.004)] * 3
    table = summary_table({"office": scores})
    (row,) = zip(*(column.cells for column in table.columns), strict=True)
    assert row == ("office", "0.200", "0.600", "0.400", "0.50", "12", "12")


def test_scenes_are_named_or_all():
    assert chosen_scenes("office,dusk") == ["office", "dusk"]
    assert chosen_scenes("all") == list(SCENES)
    with pytest.raises(SettingsError, match="--scenes: unknown offcie; valid: all, asphalt"):
        chosen_scenes("offcie")
