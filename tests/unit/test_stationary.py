"""Detection of a stationary camera against the slowest motion, by exact projections with noise."""

from dataclasses import replace

import numpy as np
import pytest

from vo.contract import se3
from vo.contract.rig import StereoRig
from vo.map.frame import Matches
from vo.map.state import Halt
from vo.tracking.motion_evidence import motion_evidence
from vo.tracking.stationary import (
    LIMITS,
    extend_halt,
    is_settled,
    is_stationary,
)

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
NOISE_PX = 0.08
CREEP = np.array([0.0004, 0.0, 0.001, 0.0, 0.0, 0.0])
"""A millimetre forward."""
NOWHERE = np.zeros(6)


def pictured(tangent, seed=0, count=200, noise_px=NOISE_PX):
    """Points (N, 3) in the first camera, and their flow as the camera moves by a tangent."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([20, 20], [620, 460], (count, 2))
    points = RIG.triangulate(pixels, RIG.f_px * RIG.baseline_m / rng.uniform(1, 5, count))
    moved = RIG.project(se3.transform(se3.inverse(se3.exp(tangent)), points))[:, :2]
    return points, moved - pixels + rng.normal(scale=noise_px, size=(count, 2))


def test_evidence_of_noise_has_six_degrees_of_freedom():
    every = np.eye(6)
    evidence = [motion_evidence(*pictured(NOWHERE, seed), RIG, every) for seed in range(100)]
    assert 5 < np.mean(evidence) < 8
    assert max(evidence) < LIMITS.significant


@pytest.mark.parametrize("k", range(6))
def test_evidence_is_flow_over_noise(k):
    """Along and about every axis, against the flow of exact projection."""
    tangent = np.zeros(6)
    tangent[k] = 0.002 if k < 3 else 0.001
    exact_px = pictured(tangent, noise_px=0)[1]
    evidence = motion_evidence(*pictured(tangent), RIG, np.eye(6))
    expected = (exact_px**2).sum() / NOISE_PX**2
    assert expected > 2 * LIMITS.significant
    # 400 numbers tell their deviation to 6 %.
    assert 0.7 < evidence / expected < 1.4


def test_evidence_leaves_moving_landmarks_out():
    points, flow_px = pictured(np.zeros(6))
    walks = np.abs(points[:, 0] / points[:, 2] - 0.1) < 0.12
    assert 0.1 < walks.mean() < 0.3
    flow_px[walks, 0] += 1.5
    assert motion_evidence(points, flow_px, RIG, np.eye(6)) < LIMITS.significant


def test_evidence_without_noise_is_zero():
    points, flow_px = pictured(np.zeros(6), noise_px=0)
    assert motion_evidence(points, 0 * flow_px, RIG, np.eye(6)) == 0


T_ODOM_CAM = se3.exp(np.array([1.0, 2, 3, 0.1, 0.2, 0.3]))


def shown(pixels, points_cam):
    ids, unknown = np.arange(len(pixels)), np.full(len(pixels), np.nan)
    points = se3.transform(T_ODOM_CAM, points_cam)
    return Matches(
        ids=ids, pixels=pixels, disparity_px=unknown, rows=ids, points_odom=points, features=ids,
        zncc=unknown,
    )  # fmt: skip


def seen(tangent, ticks, seed=0, noise_px=NOISE_PX, arrival=NOWHERE):
    """Where a camera rested, and its landmarks after it has moved by a tangent."""
    points, flow_px = pictured(tangent, seed, noise_px=noise_px)
    pixels = RIG.project(points)[:, :2]
    halt = Halt(T_ODOM_CAM, se3.exp(arrival), np.eye(6), ticks, (shown(pixels, points),))
    return halt, shown(pixels + flow_px, points)


def few(matches, count):
    return matches.select(np.arange(count))


def filmed(tangents, noise_px, fail=()):
    """Frame by frame, whether a camera that moves by tangents is taken to stand.

    Args:
        tangents: (N, 6) from where it came to rest; the first is the frame of that.
        noise_px: Of a landmark in a frame.
        fail: Frames that see but a few landmarks, and these where a motion of 1 cm would put them.
    """
    rng = np.random.default_rng(1)
    halt, _ = seen(np.zeros(6), None, noise_px=0)
    pixels, points = halt.first[0].pixels, pictured(np.zeros(6), noise_px=0)[0]
    told = []
    for i, tangent in enumerate(tangents):
        tangent = np.array([0.01, 0, 0, 0, 0, 0]) if i in fail else tangent
        exact = RIG.project(se3.transform(se3.inverse(se3.exp(tangent)), points))[:, :2]
        view = shown(exact + rng.normal(scale=noise_px, size=pixels.shape), points)
        view = few(view, 20) if i in fail else view
        if i == 0:
            halt = replace(halt, first=(view,))
            continue
        told.append(is_stationary(halt, view, None, RIG))
        halt = extend_halt(halt, view) if told[-1] else replace(halt, first=(view,), last=())
    return told


def test_stationary_a_still_camera_is_detected():
    halt, now = seen(np.zeros(6), None)
    assert is_stationary(halt, now, None, RIG)
    assert is_stationary(replace(halt, wheel_ticks=(7, 7)), now, (7, 8), RIG)


def test_stationary_turning_wheels_deny_it():
    halt, now = seen(np.zeros(6), (10, 10))
    assert not is_stationary(halt, now, (10, 12), RIG)
    assert is_stationary(halt, now, None, RIG)


def test_stationary_wheels_at_rest_raise_the_limit():
    limit = LIMITS.significant * (1 + LIMITS.few_frames)
    assert limit < motion_evidence(*pictured(CREEP), RIG, np.eye(6)) < LIMITS.wheels_rest * limit
    halt, now = seen(CREEP, (10, 10))
    assert not is_stationary(halt, now, None, RIG)
    assert is_stationary(halt, now, (10, 10), RIG)


def test_evidence_along_one_motion_has_one_degree_of_freedom():
    along = CREEP[:, None]
    evidence = [motion_evidence(*pictured(NOWHERE, seed), RIG, along) for seed in range(100)]
    assert 0.6 < np.mean(evidence) < 1.5
    assert max(evidence) < LIMITS.coasting


def test_stationary_coasting_along_the_arrival_is_motion():
    """Less than a millimetre is too little to end a halt, unless that is how the camera arrived."""
    slower = 0.7 * CREEP
    aside = np.array([0, 0.003, 0, 0, 0, 0])
    for arrival, still in ((NOWHERE, True), (aside, True), (3 * CREEP, False)):
        told = [
            is_stationary(*seen(slower, None, seed, arrival=arrival), None, RIG)
            for seed in range(20)
        ]
        assert np.mean(told) > 0.9 if still else np.mean(told) < 0.1
    at_rest = [
        is_stationary(*seen(NOWHERE, None, k, arrival=3 * CREEP), None, RIG) for k in range(50)
    ]
    assert all(at_rest)


def test_stationary_settled_halts_do_not_coast():
    """What a young halt takes for the end of the way, an old one takes for noise."""
    halt, now = seen(0.7 * CREEP, None, arrival=3 * CREEP)
    assert not is_stationary(halt, now, None, RIG)
    old = replace(halt, first=LIMITS.pooled_frames * halt.first)
    assert not is_settled(halt)
    assert is_settled(old)
    assert is_stationary(old, now, None, RIG)


@pytest.mark.parametrize("carried", [CREEP * 2.5, np.array([0, 0, 0, 0, 0.003, 0])])
def test_stationary_carried_with_resting_wheels_is_motion(carried):
    halt, now = seen(carried, (10, 10))
    assert not is_stationary(halt, now, (10, 10), RIG)


def test_stationary_few_landmarks_are_not_enough():
    halt, now = seen(np.zeros(6), None)
    assert not is_stationary(halt, few(now, 8), None, RIG)


@pytest.mark.parametrize("mm_per_s", [1.0, 3.0])
def test_stationary_creep_below_frame_noise_ends_a_halt(mm_per_s):
    """At 15 Hz; it is held back by a millimetre or two at most, and seen again and again."""
    tangents = np.zeros((90, 6))
    tangents[:, 2] = 1e-3 * mm_per_s / 15 * np.arange(90)
    told = np.array(filmed(tangents, NOISE_PX))
    assert told[0]  # no single frame shows it
    moved_mm = np.diff(np.flatnonzero(~told)) * mm_per_s / 15
    assert (~told).sum() >= 3
    assert moved_mm.max() < 2


def test_stationary_creep_of_tyres_in_noise_is_held():
    """A seventh of a pixel in ten seconds is less than the error of a new pose in such noise."""
    tangents = np.zeros((150, 6))
    tangents[:, 4] = 3e-4 * np.linspace(0, 1, 150)
    assert all(filmed(tangents, 3 * NOISE_PX))


def test_stationary_wrong_frames_do_not_end_a_halt():
    assert all(filmed(np.zeros((60, 6)), NOISE_PX, fail=(20, 31, 45)))
    moved = np.zeros((60, 6))
    moved[20:, 0] = 0.01
    assert filmed(moved, NOISE_PX).index(False) == 19  # many landmarks need no second frame


def test_halt_keeps_first_and_last_frames_apart():
    halt, now = seen(np.zeros(6), None)
    count, first, last = 40, LIMITS.reference_frames, LIMITS.pooled_frames
    for k in range(count):
        halt = extend_halt(halt, few(now, 20 + k))
    assert [len(x.ids) for x in halt.first[1:]] == [20 + k for k in range(first - 1)]
    assert [len(x.ids) for x in halt.last] == [20 + count - last + k for k in range(last)]
