"""Textures: reproducible, never alike, with contrast in the band that the camera resolves."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from scenes.surfaces import greenery, masonry, prints, sky, textile, timber
from scenes.surfaces.atlas import pack
from scenes.surfaces.noise import fractal, ramp

SHEETS = {
    "paving_bricks": lambda rng: masonry.paving_bricks(rng, 6, (100, 200)),
    "wall_bricks": lambda rng: masonry.wall_bricks(rng, 6, (48, 140)),
    "carpet_tiles": lambda rng: textile.carpet_tiles(rng, 3, 250),
    "leaves": lambda rng: greenery.leaves(rng, 2, 128),
    "fallen_leaves": lambda rng: greenery.fallen_leaves(rng, 6, 64),
    "posters": lambda rng: prints.posters(rng, 4, (210, 150)),
    "book_rows": lambda rng: prints.book_rows(rng, 3, (96, 336)),
    "screens": lambda rng: prints.screens(rng, 3, (100, 170)),
    "cartons": lambda rng: prints.cartons(rng, 4, 128),
}
SINGLES = {
    "sand": lambda rng: masonry.sand(rng, 128),
    "concrete": lambda rng: masonry.concrete(rng, (128, 128)),
    "plaster": lambda rng: masonry.plaster(rng, (128, 256), (200, 190, 170)),
    "gravel": lambda rng: masonry.gravel(rng, 128),
    "lawn": lambda rng: greenery.lawn(rng, 256),
    "soil": lambda rng: greenery.soil(rng, 128),
    "wood": lambda rng: timber.wood(rng, (128, 256), (142, 108, 74)),
    "painted": lambda rng: timber.painted(rng, (128, 128), (150, 150, 150)),
    "fabric": lambda rng: textile.fabric(rng, 128, (66, 84, 108)),
    "notes": lambda rng: prints.notes(rng, (240, 250)),
    "town_sky": lambda rng: sky.town_sky(rng, 32),
    "window_view": lambda rng: sky.window_view(rng, (64, 96)),
}
GROUND = ("paving_bricks", "carpet_tiles")


@pytest.mark.parametrize("name", [*SHEETS, *SINGLES])
def test_texture_same_seed_same_image_other_seed_other(name):
    draw = (SHEETS | SINGLES)[name]
    first, again, other = (draw(np.random.default_rng(seed)) for seed in (4, 4, 5))
    assert first.dtype == np.uint8
    assert first.shape[-1] == 3
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


@pytest.mark.parametrize("name", SHEETS)
def test_atlas_cells_all_differ(name):
    cells = SHEETS[name](np.random.default_rng(0)).astype(float)
    for i in range(len(cells)):
        for j in range(i):
            assert np.abs(cells[i] - cells[j]).mean() > 4


@pytest.mark.parametrize("name", GROUND)
def test_ground_texture_has_contrast_at_every_scale(name):
    grey = SHEETS[name](np.random.default_rng(1)).astype(float).mean(axis=-1)[:, 6:-6, 6:-6]
    for fine_px, coarse_px in ((0.7, 2), (2, 6), (6, 18)):
        band = gaussian_filter(grey, (0, fine_px, fine_px)) - gaussian_filter(
            grey, (0, coarse_px, coarse_px)
        )
        assert 1.5 < band.std() < 25, (fine_px, coarse_px)


@pytest.mark.parametrize("name", GROUND)
def test_ground_texture_is_not_clipped(name):
    image = SHEETS[name](np.random.default_rng(2))
    assert np.mean(image < 8) < 0.002
    assert np.mean(image > 247) < 0.002


def test_fractal_power_lies_in_its_band():
    noise = fractal(np.random.default_rng(0), (256, 256), (8, 32), slope=0.0)
    power = np.abs(np.fft.fft2(noise)) ** 2
    frequency = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256)[None])
    inside = (frequency >= 1 / 32) & (frequency <= 1 / 8)
    assert noise.std() == pytest.approx(1, abs=1e-3)
    assert noise.mean() == pytest.approx(0, abs=1e-5)
    assert power[inside].sum() > 0.8 * power.sum()
    assert power[frequency < 1 / 33].sum() < 1e-6 * power.sum()


def test_fractal_stretched_is_longer_along_columns():
    noise = fractal(np.random.default_rng(0), (256, 256), (4, 64), stretch=4.0)
    along, across = (np.abs(np.diff(noise, axis=axis)).mean() for axis in (1, 0))
    assert across > 2 * along


def test_ramp_passes_through_its_stops():
    stops = ((0, 0, 0), (10, 20, 30), (100, 100, 100))
    colours = ramp(stops, np.array([-1, 0, 0.25, 0.5, 1, 2]))
    expected = [(0, 0, 0), (0, 0, 0), (5, 10, 15), (10, 20, 30), (100,) * 3, (100,) * 3]
    np.testing.assert_allclose(colours, expected)


@pytest.mark.parametrize("count", [1, 2, 7, 16])
def test_pack_rectangles_hold_their_cell_within_its_border(count):
    cells = np.random.default_rng(0).integers(0, 255, (count, 10, 20, 3), dtype=np.uint8)
    atlas = pack(cells, gutter_px=3)
    assert atlas.count == count
    height, width = atlas.image.shape[:2]
    for cell, (u0, v0, u1, v1) in zip(cells, atlas.rects, strict=True):
        left, right = round(u0 * width), round(u1 * width)
        top, bottom = round(v0 * height), round(v1 * height)
        np.testing.assert_array_equal(atlas.image[top:bottom, left:right], cell)
        gutter = atlas.image[top - 3 : top, left:right]
        np.testing.assert_array_equal(gutter, np.repeat(cell[:1], 3, axis=0))
