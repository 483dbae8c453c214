"""Standing still is told from the slowest motion, by exact projections with known noise."""

from dataclasses import replace

import numpy as np
import pytest

from vo.contract import se3
from vo.contract.rig import StereoRig
from vo.correspondence import Matches
from vo.standing import SIGNIFICANT, WHEELS_REST, Rest, motion_evidence, stands

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
NOISE_PX = 0.08
CREEP = np.array([0.0002, 0.0, 0.0005, 0.0, 0.0, 0.0])
"""Half a millimetre forward."""


def pictured(tangent, seed=0, count=200, noise_px=NOISE_PX):
    """Points (N, 3) in the first camera, and their flow as the camera moves by a tangent."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([20, 20], [620, 460], (count, 2))
    points = RIG.triangulate(pixels, RIG.f_px * RIG.baseline_m / rng.uniform(1, 5, count))
    moved = RIG.project(se3.transform(se3.inverse(se3.exp(tangent)), points))[:, :2]
    return points, moved - pixels + rng.normal(scale=noise_px, size=(count, 2))


def test_noise_alone_has_six_degrees_of_freedom():
    evidence = [motion_evidence(*pictured(np.zeros(6), seed), RIG) for seed in range(100)]
    assert 5 < np.mean(evidence) < 8
    assert max(evidence) < SIGNIFICANT


@pytest.mark.parametrize("k", range(6))
def test_evidence_is_flow_over_noise(k):
    """Along and about every axis, against the flow of exact projection."""
    tangent = np.zeros(6)
    tangent[k] = 0.002 if k < 3 else 0.001
    exact_px = pictured(tangent, noise_px=0)[1]
    evidence = motion_evidence(*pictured(tangent), RIG)
    expected = (exact_px**2).sum() / NOISE_PX**2
    assert expected > 2 * SIGNIFICANT
    # 400 numbers tell their deviation to 6 %.
    assert 0.7 < evidence / expected < 1.4


def test_who_moves_by_himself_is_no_evidence():
    points, flow_px = pictured(np.zeros(6))
    walks = np.abs(points[:, 0] / points[:, 2] - 0.1) < 0.12
    assert 0.1 < walks.mean() < 0.3
    flow_px[walks, 0] += 1.5
    assert motion_evidence(points, flow_px, RIG) < SIGNIFICANT


def test_without_noise_nothing_divides_by_zero():
    points, flow_px = pictured(np.zeros(6), noise_px=0)
    assert motion_evidence(points, 0 * flow_px, RIG) == 0


def seen(tangent, ticks, seed=0):
    """Where a camera rested, and its landmarks after it has moved by a tangent."""
    points, flow_px = pictured(tangent, seed)
    ids, n = np.arange(len(points)), len(points)
    pixels = RIG.project(points)[:, :2]
    T_odom_cam = se3.exp(np.array([1.0, 2, 3, 0.1, 0.2, 0.3]))
    measured = np.column_stack([pixels + flow_px, np.full(n, np.nan)])
    matches = Matches(
        ids, ids, se3.transform(T_odom_cam, points), ids, measured, np.ones((n, 3)), np.ones(n)
    )
    return Rest(T_odom_cam, np.eye(6), ids, pixels, ticks), matches


def test_a_still_camera_stands():
    rest, matches = seen(np.zeros(6), None)
    assert stands(rest, matches, None, RIG)
    assert stands(replace(rest, wheel_ticks=(7, 7)), matches, (7, 8), RIG)


def test_wheels_that_turn_deny_it():
    rest, matches = seen(np.zeros(6), (10, 10))
    assert not stands(rest, matches, (10, 12), RIG)
    assert stands(rest, matches, None, RIG)


def test_wheels_at_rest_excuse_a_little_flow():
    rest, matches = seen(CREEP, (10, 10))
    assert SIGNIFICANT < motion_evidence(*pictured(CREEP), RIG) < WHEELS_REST * SIGNIFICANT
    assert not stands(rest, matches, None, RIG)
    assert stands(rest, matches, (10, 10), RIG)


@pytest.mark.parametrize("carried", [CREEP * 5, np.array([0, 0, 0, 0, 0.003, 0])])
def test_wheels_at_rest_do_not_excuse_being_carried(carried):
    rest, matches = seen(carried, (10, 10))
    assert not stands(rest, matches, (10, 10), RIG)


def test_too_few_landmarks_tell_nothing():
    rest, matches = seen(np.zeros(6), None)
    assert not stands(rest, matches.select(np.arange(200) < 8), None, RIG)
