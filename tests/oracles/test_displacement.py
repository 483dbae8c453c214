"""Displacements of patches in halved images, on textures that are moved by known amounts."""

import numpy as np
import pytest
from test_alignment import SIZE, Texture

from vo.patches.displacement_search import halve, search_displacements

PIXELS = np.array([[40.3, 35.8], [70.0, 60.0], [95.6, 80.1], [52.5, 84.5], [100.2, 40.7]])


def displaced(shift, guess_error=(0, 0), radius_px=8.0, pixels=PIXELS):
    texture, shift = Texture(3), np.asarray(shift, float)
    before, now = halve(texture.image()), halve(texture.image(target=shift))
    return search_displacements(before, now, pixels, pixels + shift + guess_error, radius_px)


@pytest.mark.parametrize("shift", [(0, 0), (2.0, -4.0), (3.3, 1.6), (-5.7, 2.9)])
@pytest.mark.parametrize("guess_error", [(0, 0), (5.0, -6.0)])
def test_displacement_is_found_to_half_a_pixel(shift, guess_error):
    found, zncc = displaced(shift, guess_error)
    assert np.abs(found - PIXELS - shift).max() < 0.5
    assert zncc.min() > 0.9


def test_displacement_beyond_the_radius_is_not_found():
    found, _ = displaced((3.0, 2.0), guess_error=(14.0, 0.0))
    assert np.abs(found - PIXELS - (3.0, 2.0)).max(axis=1).min() > 1
    wide, _ = displaced((3.0, 2.0), guess_error=(14.0, 0.0), radius_px=16.0)
    assert np.abs(wide - PIXELS - (3.0, 2.0)).max() < 0.5


def test_displacement_without_a_patch_is_unknown():
    """At the edge, far outside, unknown, and of a flat patch."""
    pixels = np.array([[3.0, 50.0], [70.0, 60.0], [np.nan, 5.0]])
    found, zncc = displaced((0, 0), pixels=pixels)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), [True, False, True])
    np.testing.assert_array_equal(np.isnan(zncc), [True, False, True])
    beyond, _ = displaced((0, 0), guess_error=(500.0, 0), pixels=pixels)
    assert np.isnan(beyond).all()
    flat = np.full((SIZE[1] // 2, SIZE[0] // 2), 90, np.uint8)
    assert np.isnan(search_displacements(flat, flat, PIXELS, PIXELS, 8.0)[0]).all()
