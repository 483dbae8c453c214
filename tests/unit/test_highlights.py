"""The share of pixels beyond the noise, on histograms with known answers; finishes by name."""

from types import SimpleNamespace

import numpy as np
import pytest

from scenes.surfaces.finish import FINISHES, MATTE, finish_of
from sim.certificate.highlights import DEVIATIONS, beyond_noise_fraction
from sim.certificate.photometric import BINS_PER_GREY, MEDIAN_OF_NORMAL


def residual(levels: np.ndarray, sigma: float) -> SimpleNamespace:
    bins = np.rint(np.abs(levels) * BINS_PER_GREY).astype(int)
    histogram = np.bincount(bins, minlength=256 * BINS_PER_GREY + 1)
    return SimpleNamespace(histogram=histogram, noise_median=MEDIAN_OF_NORMAL * sigma)


def test_noise_alone_leaves_hardly_a_pixel_beyond_it():
    noise = np.random.default_rng(0).normal(0, 2.0, 100_000)
    assert beyond_noise_fraction([residual(noise, 2.0)]) < 2e-4


def test_highlights_are_counted_over_all_frames():
    bright = np.zeros(1000)
    bright[:30] = DEVIATIONS * 2.0 + 1
    found = beyond_noise_fraction([residual(bright, 2.0), residual(np.zeros(1000), 2.0)])
    assert found == pytest.approx(0.015)


@pytest.mark.parametrize("name", ["paint_3", "paint"])
def test_finish_is_that_of_the_name_without_its_number(name):
    assert finish_of(name) == FINISHES["paint"]


def test_materials_without_a_finish_are_matte():
    assert finish_of("soil") == MATTE
