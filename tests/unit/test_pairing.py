"""Pairs of images by time, and the choice of frames."""

from pathlib import Path

import numpy as np
import pytest

from vo.contract.errors import DatasetError, SettingsError
from vo.contract.remarks import Remark
from vo.recordings.pairing import FrameSelection, pair_by_time

MS = 1_000_000
PERIOD_NS = 50 * MS


def eye(times_ms, side):
    times = np.round(np.array(times_ms) * MS).astype(np.int64)
    return times, [Path(f"{side}{k}.png") for k in range(len(times))]


def names(files):
    return [x.name for x in files]


@pytest.mark.parametrize(
    ("left", "right", "pairs", "message"),
    [
        ([0, 50, 100], [0, 100], [(0, 0), (2, 1)], "3 images left, 2 right: the 2 common pairs"),
        ([0, 100], [0, 50, 100, 150], [(0, 0), (1, 2)], "2 images left, 4 right: the 2 common"),
        ([0, 50, 100], [50, 100, 150], [(1, 0), (2, 1)], "the 2 common pairs"),
        ([0, 50, 100], [0.015, 50.015, 100.015], [(0, 0), (1, 1), (2, 2)], "up to 0.015 ms"),
        ([0, 50, 100], [-2.9, 52.9, 100], [(0, 0), (1, 1), (2, 2)], "up to 2.9 ms"),
        ([0, 50, 100], [0, 54, 100], [(0, 0), (2, 2)], "the 2 common pairs"),
    ],
)
def test_nearest_times_within_the_tolerance_are_pairs(left, right, pairs, message):
    with pytest.warns(Remark, match=message):
        files = pair_by_time(Path("d"), eye(left, "l"), eye(right, "r"))
    assert names(files.left) == [f"l{i}.png" for i, _ in pairs]
    assert names(files.right) == [f"r{j}.png" for _, j in pairs]
    assert files.timestamps_ns.tolist() == [left[i] * MS for i, _ in pairs]


def test_equal_times_bring_no_remark():
    assert len(pair_by_time(Path("d"), eye([0, 50], "l"), eye([0, 50], "r"))) == 2


@pytest.mark.parametrize("delay_ms", [5, 20])
def test_no_pair_states_the_smallest_difference(delay_ms):
    right = eye([delay_ms, 50 + delay_ms], "r")
    with pytest.raises(DatasetError, match=rf"differ by {delay_ms} ms or more, .* is 3 ms"):
        pair_by_time(Path("d"), eye([0, 50], "l"), right)
    with pytest.warns(Remark, match=f"up to {delay_ms} ms"):
        assert len(pair_by_time(Path("d"), eye([0, 50], "l"), right, 24.0)) == 2


def test_tolerance_stays_below_half_a_period():
    with pytest.raises(SettingsError, match="half of the period of 50 ms"):
        pair_by_time(Path("d"), eye([0, 50], "l"), eye([0, 50], "r"), 25.0)
    fast = [0, 4, 8]
    with pytest.raises(DatasetError, match=r"the tolerance .* is 1 ms"):
        pair_by_time(Path("d"), eye(fast, "l"), eye([x + 1.5 for x in fast], "r"))


def test_eye_without_images_is_refused():
    with pytest.raises(DatasetError, match="no frames"):
        pair_by_time(Path("d"), eye([0, 50], "l"), eye([], "r"))


@pytest.mark.parametrize(
    ("selection", "rows"),
    [
        (FrameSelection(), [0, 1, 2, 3, 4]),
        (FrameSelection(first=1, last=3), [1, 2, 3]),
        (FrameSelection(first=1, every=2), [1, 3]),
        (FrameSelection(last=0), [0]),
    ],
)
def test_selected_rows(selection, rows):
    assert list(range(5))[selection.rows(5, Path("d"))] == rows


@pytest.mark.parametrize(
    "selection", [FrameSelection(first=5), FrameSelection(last=5), FrameSelection(first=3, last=2)]
)
def test_empty_selection_names_the_frames_there_are(selection):
    with pytest.raises(SettingsError, match="d has frames 0 to 4"):
        selection.rows(5, Path("d"))
