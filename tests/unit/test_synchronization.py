"""Recordings whose eyes do not show the same moments."""

import cv2
import numpy as np
import pytest
from folders import BASELINE_M, F_PX, HEIGHT, WIDTH, wall

from vo.contract.remarks import Remark
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoSequence
from vo.recordings.synchronization import remark_unsynchronized

FRAMES = 6


def recording(shift=0, step_px=4, row_px=0):
    """A wall that moves diagonally, the right eye late by a number of frames and rolled by rows."""
    pairs = wall(FRAMES + 2, abs(step_px))

    def load(i):
        left, right = pairs[i + 1][0], pairs[i + 1 - shift][1]
        return np.roll(left, i * step_px, 0), np.roll(right, (i - shift) * step_px + row_px, 0)

    rig = StereoRig(WIDTH, HEIGHT, F_PX, WIDTH / 2, HEIGHT / 2, BASELINE_M)
    return StereoSequence("walk", rig, np.arange(FRAMES) * 10**8, load)


@pytest.mark.parametrize(("shift", "when"), [(1, "after"), (-1, "before")])
def test_shift_by_a_frame_is_said(shift, when):
    with pytest.warns(
        Remark, match=rf"right ones of the frame {when} better .* shifted by a frame"
    ):
        remark_unsynchronized(recording(shift))


@pytest.mark.parametrize("shift", [0, 1])
def test_camera_at_rest_brings_no_remark(shift):
    remark_unsynchronized(recording(shift, step_px=0))


def test_synchronized_eyes_bring_no_remark():
    remark_unsynchronized(recording())


def test_repetitive_texture_brings_no_remark():
    # The next dot of the pattern lies four rows off; only the noise tells the dots apart. A tracker
    # that starts at zero disparity takes it for the true one, 52 columns away.
    v, u = np.mgrid[:HEIGHT, : WIDTH + 52]
    along, across = 40 * u + 4 * v, 40 * v - 4 * u
    waves = [np.cos(2 * np.pi * x / (40 * np.hypot(40, 4))) for x in (along, across)]
    noise = np.random.default_rng(0).integers(40, 80, v.shape)
    image = cv2.GaussianBlur((100 * (sum(waves) > 0.6) + noise).astype(np.uint8), (3, 3), 0)
    pair = image[:, :WIDTH], image[:, 52:]
    walk = recording()
    remark_unsynchronized(StereoSequence("x", walk.rig, walk.timestamps_ns, lambda i: pair))


def test_swapped_or_equal_eyes_are_said():
    walk, black = recording(), np.zeros((HEIGHT, WIDTH), np.uint8)

    def other(load):
        return StereoSequence("x", walk.rig, walk.timestamps_ns, load)

    with pytest.warns(Remark, match="x: the right images fit as left ones: are the eyes swapped"):
        remark_unsynchronized(other(lambda i: (walk[i].right, walk[i].left)))
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 255, (2, HEIGHT, WIDTH), np.uint8) for _ in range(FRAMES)]
    remark_unsynchronized(other(lambda i: tuple(noise[i])))
    with pytest.warns(Remark, match="left and right are the same images"):
        remark_unsynchronized(other(lambda i: (walk[i].left, walk[i].left)))
    remark_unsynchronized(other(lambda _: (black, black)))


def test_rows_that_differ_are_said():
    with pytest.warns(Remark, match="left and right differ by 3.0 rows"):
        remark_unsynchronized(recording(step_px=0, row_px=3))


def test_blank_images_bring_no_remark():
    blank = np.zeros((HEIGHT, WIDTH), np.uint8)
    walk = recording()
    remark_unsynchronized(
        StereoSequence("x", walk.rig, walk.timestamps_ns, lambda i: (blank, blank))
    )
