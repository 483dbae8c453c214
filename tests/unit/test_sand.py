"""Sand in low sun: shaded by its relief, and without a seam where wheel tracks are drawn."""

import cv2
import numpy as np
import pytest

from scenes.geometry.routes import Ribbon, rounded_loop
from scenes.lighting.baked_light import lamp
from scenes.structures.wheel_tracks import (
    HALF_M,
    PIECES,
    TEXEL_M,
    Sand,
    track_mesh,
    track_texture,
)
from scenes.surfaces import sand

LIGHT = lamp((0.7, 18.0), on_ground=(0.44, 0.4, 0.33), fill=(0.25, 0.26, 0.3), ambient=(0.2,) * 3)
LAMPS = LIGHT.key_rgb, LIGHT.fill_rgb + LIGHT.ambient_rgb


@pytest.fixture(scope="module")
def land() -> Sand:
    rng, shape = np.random.default_rng(0), (256, 256)
    return Sand(sand.relief(rng, shape, TEXEL_M), sand.grains(rng, shape))


def test_level_sand_has_its_own_colour_and_slopes_face_the_sun():
    colour = np.full((1, 3, 3), 120.0, np.float32)
    tilt = np.array([[0.0, -0.2, 0.2]])  # level, towards the sun, away from it
    rise = tilt * LIGHT.key[0], tilt * LIGHT.key[1]
    level, towards, away = sand.shaded(colour, rise, LIGHT.key, LAMPS)[0]
    np.testing.assert_allclose(level, 120, rtol=1e-5)
    assert (towards > 1.1 * level).all()
    assert (away < 0.9 * level).all()
    assert towards[0] / towards[2] > level[0] / level[2]  # the sun is warmer than the sky


def test_strip_of_tracks_joins_the_sand_beside_it(land):
    """At the rim of the strip its texture is that of the sand at the same place of the world."""
    corners = np.array([(1.2, -1.0), (1.2, 1.0), (-1.2, 1.0), (-1.2, -1.0)])
    ribbon = Ribbon(rounded_loop(corners, radius_m=0.9))
    strip = track_texture(np.random.default_rng(1), ribbon, land, LIGHT).astype(float)
    mesh, around = track_mesh(ribbon), land.texture(LIGHT).astype(np.float32)
    np.testing.assert_array_equal(mesh.points[:, 2], 0)
    size = strip.shape[1::-1]
    away = np.linalg.norm(mesh.points[:, None, :2] - ribbon.route, axis=2).min(axis=1)
    rim = (away > HALF_M - 0.005) & (mesh.uv[:, 0] % 1 > 0.01) & (mesh.uv[:, 0] % 1 < 0.99)
    assert rim.sum() > 100
    u, v = (mesh.uv[rim] * size - 0.5).T.astype(np.float32)
    mine = cv2.remap(strip, u[None], v[None], cv2.INTER_LINEAR)[0]
    x, y = (mesh.points[rim, :2].T / TEXEL_M % 256).astype(np.float32)
    theirs = cv2.remap(around, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)[0]
    assert np.abs(mine - theirs).mean() < 0.5 * around.std()
    assert np.corrcoef(mine[:, 0], theirs[:, 0])[0, 1] > 0.8
    middle = strip[: strip.shape[0] // PIECES]
    assert middle.std() > around.std()  # ruts are deeper than ripples
