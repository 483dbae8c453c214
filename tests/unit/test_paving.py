"""Bricks: each spot paved once, heights as asked, drawings where the poses say."""

import numpy as np
import pytest

from scenes.geometry.routes import resampled, rounded_loop, route_length
from scenes.structures.paving import BEVEL_M, SKIRT_M, brick_flanks, brick_tops, lay

BONDS = ("herringbone", "running")


@pytest.mark.parametrize("bond", BONDS)
@pytest.mark.parametrize("cells", [(12, 9), (7, 10), (1, 1)])
def test_lay_covers_every_module_exactly_once(bond, cells):
    paving = lay(np.random.default_rng(0), cells, 0.1, 0.004, 0.0, bond)
    covered = np.zeros(cells, dtype=int)
    low = paving.centre[:, :2] - paving.reach - 0.002
    first = np.round(low / 0.1 + np.asarray(cells) / 2).astype(int)
    size = np.round((paving.reach + 0.002) * 2 / 0.1).astype(int)
    for (i, j), (ni, nj) in zip(first, size, strict=True):
        covered[i : i + ni, j : j + nj] += 1
    np.testing.assert_array_equal(covered, 1)


@pytest.mark.parametrize("bond", BONDS)
def test_lay_most_bricks_are_whole(bond):
    paving = lay(np.random.default_rng(0), (40, 30), 0.1, 0.004, 0.002, bond)
    whole = paving.half[:, 0] > 0.06
    assert whole.mean() > 0.9
    np.testing.assert_allclose(paving.half[whole], [[0.098, 0.048]] * whole.sum())
    np.testing.assert_allclose(paving.half[~whole], 0.048)


def test_lay_heights_have_their_std_and_are_clipped():
    paving = lay(np.random.default_rng(0), (120, 90), 0.1, 0.004, 0.002, "herringbone")
    height = paving.centre[:, 2]
    assert height.std() == pytest.approx(0.002, rel=0.1)
    assert np.abs(height).max() == pytest.approx(0.004)
    assert abs(height.mean()) < 1e-4


def test_brick_tops_lie_on_the_planes_of_their_poses():
    rng = np.random.default_rng(0)
    paving = lay(rng, (6, 5), 0.1, 0.004, 0.002, "herringbone")
    count = len(paving.centre)
    mesh = brick_tops(
        paving, np.tile([0, 0, 1.0, 1], (count, 1)), np.zeros(count, dtype=bool), (4, 2)
    )
    points = mesh.points.reshape(count, 8, 4, 3)
    offset = points - paving.centre[:, None, None]
    rise = (offset[..., :2] * paving.slope[:, None, None]).sum(axis=-1)
    np.testing.assert_allclose(offset[..., 2], rise, atol=1e-12)
    extent = np.abs(offset[..., :2]).max(axis=(1, 2))
    np.testing.assert_allclose(extent, paving.reach - BEVEL_M)


def test_brick_flanks_close_the_rim_of_the_tops():
    paving = lay(np.random.default_rng(0), (6, 5), 0.1, 0.004, 0.002, "herringbone")
    count = len(paving.centre)
    looks = np.tile([0, 0, 1.0, 1], (count, 1)), np.zeros(count, dtype=bool)
    tops = brick_tops(paving, *looks).points.reshape(count, 4, 3)
    flanks = brick_flanks(paving, *looks).points.reshape(count, 4, 4, 3)
    rims = np.sort(flanks[:, :, 3], axis=1), np.sort(tops, axis=1)
    np.testing.assert_allclose(*rims, atol=1e-12)
    lows = flanks[:, :, :2]
    extent = np.abs(lows - paving.centre[:, None, None])[..., :2].max(axis=(1, 2))
    np.testing.assert_allclose(extent, paving.reach)
    below = paving.centre[:, None, None, 2] - lows[..., 2]
    np.testing.assert_allclose(below, SKIRT_M, atol=1e-3)


@pytest.mark.parametrize("draw", [brick_tops, brick_flanks])
def test_brick_faces_all_face_outward(draw):
    paving = lay(np.random.default_rng(0), (4, 4), 0.1, 0.004, 0.002, "herringbone")
    count = len(paving.centre)
    mesh = draw(paving, np.tile([0, 0, 1.0, 1], (count, 1)), np.zeros(count, dtype=bool))
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    outward = mesh.normals[mesh.faces].mean(axis=1)
    assert np.all((np.cross(b - a, c - a) * outward).sum(axis=1) > 0)


def test_rounded_loop_has_the_length_of_its_sides_and_arcs():
    square = np.array([[1.0, -1], [1, 1], [-1, 1], [-1, -1]])
    loop = rounded_loop(square, 0.5, step_m=0.02)
    assert route_length(loop) == pytest.approx(4 * 1 + 2 * np.pi * 0.5, rel=2e-3)
    np.testing.assert_array_equal(loop[0], loop[-1])
    np.testing.assert_allclose(loop[0], [0, -1])
    np.testing.assert_allclose(np.linalg.norm(np.diff(loop, axis=0), axis=1), 0.02, rtol=0.02)


def test_rounded_loop_without_room_for_arcs_is_refused():
    with pytest.raises(ValueError, match="too short"):
        rounded_loop(np.array([[1.0, -1], [1, 1], [-1, 1], [-1, -1]]), 1.2)


def test_resampled_keeps_both_ends():
    path = resampled(np.array([[0.0, 0], [1, 0], [1, 1]]), 0.3)
    np.testing.assert_array_equal(path[[0, -1]], [[0, 0], [1, 1]])
    assert len(path) == 8
