"""Baked light: the solved normals give the wanted shares, shadows fall where geometry says."""

import numpy as np
import pytest

from scenes.lighting.baked_light import FILL_SHARE, Light, shaded_normals
from scenes.lighting.shadow import Occluder, ground_light, occlusion, visibility

SUN = Light(
    key=np.array([0.6, 0.0, 0.8]),
    key_rgb=np.ones(3),
    fill_rgb=np.ones(3),
    ambient_rgb=np.zeros(3),
    softness_rad=1e-6,
)
BOX = Occluder(np.array([0.0, 0.0, 0.5]), np.array([0.1, 0.2, 0.5]))


def test_shaded_normals_are_unit_and_give_both_shares():
    rng = np.random.default_rng(0)
    normals = rng.standard_normal((400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    key_share, fill_share = rng.random((2, 400))
    solved = shaded_normals(normals, key_share, fill_share, SUN)
    np.testing.assert_allclose(np.linalg.norm(solved, axis=1), 1, atol=1e-9)
    wanted_key = key_share * np.maximum(normals @ SUN.key, 0)
    np.testing.assert_allclose(solved @ SUN.key, wanted_key, atol=1e-9)
    wanted_fill = FILL_SHARE * fill_share * (0.55 + 0.45 * normals[:, 2])
    slack = np.sqrt((1 - SUN.key[2] ** 2) * (1 - wanted_key**2))
    feasible = np.abs(wanted_fill - SUN.key[2] * wanted_key) < 0.999 * slack
    assert feasible.mean() > 0.5
    np.testing.assert_allclose(solved[feasible, 2], wanted_fill[feasible], atol=1e-9)


def test_shaded_normals_level_ground_takes_the_whole_fill():
    up = np.tile([0.0, 0, 1], (2, 1))
    solved = shaded_normals(up, np.array([1.0, 0.0]), np.ones(2), SUN)
    np.testing.assert_allclose(solved @ SUN.key, [0.8, 0], atol=1e-9)
    np.testing.assert_allclose(solved[:, 2], FILL_SHARE, atol=1e-9)


@pytest.mark.parametrize(
    ("x", "y", "seen"),
    [
        # The sun is towards +x at slope 4/3: a post of 1 m shades 0.75 m beyond its far side.
        (0.2, 0.0, 1),
        (-0.2, 0.0, 0),
        (-0.84, 0.0, 0),
        (-0.86, 0.0, 1),
        (-0.4, 0.19, 0),
        (-0.4, 0.21, 1),
    ],
)
def test_visibility_post_shadow_has_its_trigonometric_length(x, y, seen):
    assert visibility(np.array([[x, y, 0.0]]), [BOX], SUN) == pytest.approx(seen)


def test_visibility_turned_box_shades_its_turned_footprint():
    turned = Occluder(BOX.centre, BOX.half, np.pi / 2)
    points = np.array([[-0.4, 0.15, 0.0], [-0.94, 0.0, 0.0]])
    np.testing.assert_allclose(visibility(points, [BOX], SUN), [0, 1])
    np.testing.assert_allclose(visibility(points, [turned], SUN), [1, 0])


def test_visibility_foliage_passes_part_of_the_light():
    leaves = Occluder(BOX.centre, BOX.half, 0.0, 0.7)
    assert visibility(np.array([[-0.3, 0, 0]]), [leaves], SUN) == pytest.approx(0.3)


def test_visibility_box_shades_ground_but_not_its_own_parts():
    within = np.array([[0.0, 0.0, 0.2]])
    assert visibility(within, [BOX], SUN) == pytest.approx(1)
    assert visibility(within, [BOX], SUN, inside=True) == pytest.approx(0)
    assert occlusion(within, [BOX]) == pytest.approx(1)
    assert occlusion(within, [BOX], inside=True) < 0.5


def test_visibility_without_occluders_is_full():
    points = np.zeros((3, 3))
    np.testing.assert_array_equal(visibility(points, [], SUN), 1)
    np.testing.assert_array_equal(occlusion(points, []), 1)


def test_occlusion_fades_with_distance():
    points = np.array([[0.15, 0, 0], [0.4, 0, 0], [3.0, 0, 0]])
    near, middle, far = occlusion(points, [BOX])
    assert 0.4 < near < middle < far
    assert far == pytest.approx(1, abs=1e-3)


def test_light_map_agrees_with_its_rays():
    baked = ground_light((-1, -1, 1, 1), [BOX], SUN, step_m=0.1)
    samples = np.array([[-0.5, 0.0, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    key, fill = baked.at(samples)
    np.testing.assert_allclose(key, visibility(samples, [BOX], SUN))
    np.testing.assert_allclose(fill, occlusion(samples, [BOX]), atol=1e-3)
