"""CenSurE against brute force, and against blobs and lines whose place and size are known."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scale_space import scale_space
from scipy import optimize

from vo.config import FeatureSettings
from vo.features.censure import censure
from vo.features.censure_kernels import kernels
from vo.features.detector import detect

LARGEST_PX = {"box": 29, "octagon": 15 + 2 * 10, "star": 43}
KERNELS = tuple(LARGEST_PX)
EVERYTHING = FeatureSettings(count=10**6, threshold=0.0, line_ratio=1e12)
"""All extrema: nothing is too weak, too long or too many."""
GAIN = 1.5849
"""Of the smallest octagon: 1 / 0.6309, the most that it answers to a blob of contrast 1."""


def octagon(m, n, size):
    """Mask of the octagon in a square: half width h, corners cut where |x| + |y| is too large."""
    y, x = np.abs(np.mgrid[:size, :size] - size // 2)
    h = (m - 1) // 2 + n
    return (x <= h) & (y <= h) & (x + y <= h + (m - 1) // 2)


def square(half, size):
    y, x = np.abs(np.mgrid[:size, :size] - size // 2)
    return (x <= half) & (y <= half)


def star(half, size):
    """A square and a diamond whose tips stand out by half the square's half side, rounded up."""
    y, x = np.abs(np.mgrid[:size, :size] - size // 2)
    return square(half, size) | (x + y <= half + np.ceil(half / 2))


def octagon_masks(scale):
    """Centre and whole of an octagon kernel, read from its response to one white pixel."""
    spot = np.zeros((81, 81), np.uint8)
    spot[40, 40] = 255
    response = responses_of(spot)[scale]
    reach = np.abs(np.argwhere(response) - 40).max()
    inside = slice(40 - reach, 41 + reach)
    return response[inside, inside] > 0, response[inside, inside] != 0


def masks(kernel, scale):
    """Centre and whole in a square that just holds the whole."""
    if kernel == "octagon":
        return octagon_masks(scale)
    half = scale + 1
    if kernel == "box":
        return square(half, 4 * half + 1), square(2 * half, 4 * half + 1)
    return star(half, 6 * half + 1), star(2 * half, 6 * half + 1)


def best_answer(weights):
    """To a Gaussian blob of contrast 1, over all its sizes."""
    reach = len(weights) // 2
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]

    def answer(sigma):
        return (weights * np.exp((x**2 + y**2) / (-2 * sigma**2))).sum()

    best = optimize.minimize_scalar(lambda sigma: -answer(sigma), (0.5, reach / 2))
    return answer(best.x)


def brute_responses(image, kernel="octagon"):
    responses = np.zeros((7, *image.shape))
    for scale, response in enumerate(responses):
        centre, whole = masks(kernel, scale)
        ring = whole & ~centre
        weights = centre / centre.sum() - ring / ring.sum()
        weights /= best_answer(weights)
        fits = slice(len(whole) // 2, -(len(whole) // 2))
        response[fits, fits] = cv2.filter2D(image.astype(float), cv2.CV_64F, weights)[fits, fits]
    return responses


def responses_of(image, kernel="octagon"):
    return scale_space(image, kernels(kernel))


def brute_extrema(responses, kernel):
    """Value at every (scale, v, u) that beats all its 26 neighbours, none of them cut off."""
    scales, height, width = responses.shape
    edge = LARGEST_PX[kernel] // 2 + 1
    found = {}
    for s in range(1, scales - 1):
        for v in range(edge, height - edge):
            for u in range(edge, width - edge):
                around = responses[s - 1 : s + 2, v - 1 : v + 2, u - 1 : u + 2].ravel()
                value = responses[s, v, u]
                if value and (np.delete(np.sign(value) * around, 13) < abs(value)).all():
                    found[s, v, u] = value
    return found


def strongest(image, kernel):
    """(u, v, response) of the strongest extremum."""
    found = censure(image, FeatureSettings(kernel=kernel))[:, :3]
    return found[np.abs(found[:, 2]).argmax()]


def noise(shape, seed=0):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def smooth_noise(shape, seed=0):
    """Blobs of many sizes, full contrast."""
    smooth = sum(cv2.GaussianBlur(noise(shape, seed).astype(float), (0, 0), s) * s for s in (2, 5))
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def blob(u, v, sigma, contrast=120.0, shape=(120, 140)):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    bump = np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * sigma**2))
    return np.round(100 + contrast * bump).astype(np.uint8)


def oval(u, v, angle, length, breadth, shape=(120, 140)):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    x, y = columns - u, rows - v
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    bump = np.exp(-((along / length) ** 2 + (across / breadth) ** 2) / 2)
    return np.round(100 + 120 * bump).astype(np.uint8)


def bar(u, v, angle):
    return oval(u, v, angle, 15, 2.5)


def edge(angle, shape=(120, 140)):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    away = (columns - shape[1] / 2) * np.sin(angle) - (rows - shape[0] / 2) * np.cos(angle)
    return np.round(60 + 140 / (1 + np.exp(-away / 2))).astype(np.uint8)


@pytest.mark.parametrize("kernel", KERNELS)
def test_responses_equal_brute_force_sums(kernel):
    image = noise((61, 83))
    expected = brute_responses(image, kernel)
    assert (np.ptp(expected, axis=(1, 2)) > 5).all()
    np.testing.assert_allclose(responses_of(image, kernel), expected, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("scale", range(7))
def test_octagon_kernels_are_octagons_about_the_pixel(scale):
    for mask in octagon_masks(scale):
        rows = np.flatnonzero(mask.any(axis=1))
        m = mask[rows[0]].sum()
        assert 3 <= m < len(rows) or (scale == 0 and m == len(rows) == 3)
        np.testing.assert_array_equal(mask, octagon(m, (len(rows) - m) // 2, len(mask)))


def test_octagon_kernels_grow_as_published():
    """From 3 and 9 to 17 and 35 px wide; the surround's radius from 2.8 to 2 times the centre's."""
    pairs = [octagon_masks(scale) for scale in range(7)]
    widths = np.array([[x.any(axis=0).sum() for x in pair] for pair in pairs])
    assert (np.diff(widths, axis=0) > 0).all()
    np.testing.assert_array_equal(widths[[0, -1]], [[3, 9], [17, 35]])
    ratio = np.sqrt([whole.sum() / centre.sum() for centre, whole in pairs])
    assert ratio[[0, -1]] == pytest.approx([2.8, 2.0], abs=0.05)
    assert (ratio[1:] < ratio[0]).all()


def test_responses_with_sums_beyond_32_bits_are_exact():
    """The table of this image would reach 2.2e9 in its corner."""
    white = responses_of(np.full((3000, 2900), 255, np.uint8))[:, 40:-40, 40:-40]
    assert np.abs(white).max() < 1e-3
    image = np.full((3000, 2900), 255, np.uint8)
    image[2900, 2800] = 0
    assert responses_of(image)[0, 2900, 2800] == pytest.approx(-255 / 9 * GAIN, rel=1e-4)


def test_response_of_white_pixel_hand_worked():
    """One white pixel against a centre of 9 pixels and a surround of 69 - 9."""
    image = np.zeros((40, 40), np.uint8)
    image[20, 20] = 255
    smallest = responses_of(image)[0] / GAIN
    assert smallest[20, 20] == pytest.approx(255 / 9, rel=1e-4)
    assert smallest[21, 21] == pytest.approx(255 / 9, rel=1e-4)
    assert smallest[20, 22] == pytest.approx(-255 / 60, rel=1e-4)
    assert smallest[23, 23] == pytest.approx(-255 / 60, rel=1e-4)
    assert smallest[24, 23] == 0  # the corner that the octagon cuts off


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("image", [noise((70, 80)), smooth_noise((80, 90))], ids=["fine", "soft"])
def test_extrema_equal_search_of_27_neighbours(image, kernel):
    expected = brute_extrema(responses_of(image, kernel), kernel)
    found = censure(image, EVERYTHING.model_copy(update={"kernel": kernel}))
    edge = LARGEST_PX[kernel] // 2 + 1  # the brute force stays where every kernel fits
    far = np.array(image.shape[::-1]) - 1 - edge
    rounded = np.round(found[:, :2])
    inner = ((rounded >= edge) & (rounded <= far)).all(axis=1)
    values = dict(zip(found[:, 2], found[:, :2], strict=True))
    assert len(expected) > 10
    for (_, v, u), value in expected.items():
        assert np.abs(values[np.float64(value)] - [u, v]).max() <= 0.5
    # Rounding half a pixel may move a feature across the edge.
    assert abs(inner.sum() - len(expected)) <= 2


def test_censure_threshold_keeps_strong_features():
    image = smooth_noise((80, 90))
    everything = np.abs(censure(image, EVERYTHING)[:, 2])
    strong = np.abs(censure(image, EVERYTHING.model_copy(update={"threshold": 20.0}))[:, 2])
    assert 0 < len(strong) < len(everything)
    assert len(strong) == (everything > 20).sum()
    assert strong.min() > 20


@settings(deadline=None, max_examples=30)
@given(
    u=st.floats(55, 85),
    v=st.floats(50, 70),
    sigma=st.floats(2.5, 5.0),
    contrast=st.sampled_from([-90.0, -40.0, 60.0, 150.0]),
    kernel=st.sampled_from(KERNELS),
)
def test_censure_blob_is_found_at_its_centre(u, v, sigma, contrast, kernel):
    found = strongest(blob(u, v, sigma, contrast), kernel)
    assert np.hypot(*(found[:2] - [u, v])) < 0.15
    assert np.sign(found[2]) == np.sign(contrast)


def test_detect_sub_pixel_error_is_small_not_zero():
    rng = np.random.default_rng(0)
    centres = rng.uniform([55, 50], [85, 70], (40, 2))
    found = np.array([detect(blob(u, v, 3.0), FeatureSettings())[0] for u, v in centres])
    rmse = np.sqrt(((found - centres) ** 2).mean())
    assert 1e-4 < rmse < 0.05  # rounding to whole pixels would give 0.29
    assert np.abs((found - centres).mean(axis=0)).max() < 0.02


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("contrast", [-80.0, 30.0, 140.0])
def test_censure_response_is_contrast_of_blob(kernel, contrast):
    found = strongest(blob(70, 60, 3.3, contrast), kernel)
    assert found[2] == pytest.approx(contrast, rel=0.06)  # sizes lie between the scales


@pytest.mark.parametrize("kernel", KERNELS)
def test_detect_slanted_oval_is_found_at_its_centre(kernel):
    """Its height and width do not tell: the mixed derivative is needed."""
    rng = np.random.default_rng(0)
    centres = rng.uniform([55, 50], [85, 70], (40, 2))
    found = [
        detect(oval(u, v, angle, 4.2, 2.6), FeatureSettings(kernel=kernel))[0]
        for (u, v), angle in zip(centres, rng.uniform(0, np.pi, 40), strict=True)
    ]
    assert np.sqrt(((found - centres) ** 2).mean()) < 0.04  # 0.1 without


@pytest.mark.parametrize("angle_deg", [0, 20, 45, 71, 90, 135])
def test_detect_bars_and_edges_are_no_features(angle_deg):
    image = bar(90, 80, np.radians(angle_deg))
    anything = detect(image, FeatureSettings(line_ratio=1e12))
    assert np.abs(anything[0] - [90, 80]).max() < 0.1
    assert len(detect(image, FeatureSettings())) == 0
    assert len(detect(edge(np.radians(angle_deg)), FeatureSettings())) == 0
    beside = detect(np.maximum(image, blob(30, 30, 3.0)), FeatureSettings())
    assert np.abs(beside[0] - [30, 30]).max() < 0.1


def test_detect_small_cells_even_out_features():
    """A half of strong contrast does not take all the features of a weak one."""
    image = smooth_noise((160, 320)).astype(float)
    image[:, 160:] = 128 + 0.2 * (image[:, 160:] - 128)
    image = image.astype(np.uint8)
    together, apart = (
        detect(image, FeatureSettings(count=60, cell_px=cell_px)) for cell_px in (400, 40)
    )
    weak = [(x[:, 0] > 160).sum() for x in (together, apart)]
    assert len(together) == len(apart) == 60
    assert weak[0] < 6
    assert 22 < weak[1] < 38
    responses = {tuple(x[:2]): abs(x[2]) for x in censure(image, FeatureSettings())}
    for chosen in (together, apart):
        assert (np.diff([responses[tuple(x)] for x in chosen]) <= 0).all()


def test_detect_takes_best_of_each_cell_first():
    image = smooth_noise((160, 200))
    everything = detect(image, EVERYTHING)
    cells = {tuple(x) for x in np.round(everything).astype(int) // 40}
    few = detect(image, EVERYTHING.model_copy(update={"count": len(cells), "cell_px": 40}))
    # Rounding a sub-pixel position can move it over the edge of its cell, so nearly all.
    assert len({tuple(x) for x in np.round(few).astype(int) // 40}) >= len(cells) - 2


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (5, 5), (10, 200), (200, 11)])
def test_detect_too_small_image_has_no_features(shape, kernel):
    for image in (noise(shape), np.zeros(shape, np.uint8)):
        found = detect(image, FeatureSettings(kernel=kernel))
        assert len(found) == 0
        assert found.shape == (0, 2)


def test_detect_scales_beyond_image_find_nothing():
    found = detect(noise((LARGEST_PX["octagon"] - 1, 200)), FeatureSettings())
    assert len(found) > 0
    # The second largest surround fits, so it confirms extrema of the one below and no others.
    assert (found[:, 1] > 6).all()
    assert (found[:, 1] < LARGEST_PX["octagon"] - 8).all()


@pytest.mark.parametrize("grey", [0, 90, 255])
def test_detect_flat_image_has_no_features(grey):
    faintest = FeatureSettings(threshold=1e-3)  # below it is the rounding of the sums
    assert len(detect(np.full((120, 160), grey, np.uint8), faintest)) == 0


def test_detect_same_image_gives_same_features():
    a, b = (detect(smooth_noise((120, 160)), FeatureSettings()) for _ in range(2))
    np.testing.assert_array_equal(a, b)


def test_censure_turned_image_has_turned_features():
    image = smooth_noise((100, 130))
    there, turned, inverted = (
        censure(x, EVERYTHING) for x in (image, np.ascontiguousarray(image.T), 255 - image)
    )
    assert len(there) == len(turned) == len(inverted) > 50
    pixels, swapped = there[:, :2], turned[:, 1::-1]
    order, other = (np.lexsort(np.round(x, 3).T) for x in (pixels, swapped))
    np.testing.assert_allclose(pixels[order], swapped[other], atol=1e-3)
    np.testing.assert_allclose(np.sort(there[:, 2]), np.sort(-inverted[:, 2]), atol=1e-3)
