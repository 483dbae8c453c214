"""ZNCC and mutual nearest neighbours against plain double loops."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vo.config import MatchingSettings
from vo.patches.zncc import describe, match_mutual

PATCH_PX = 9
R = PATCH_PX // 2
SETTINGS = MatchingSettings(min_zncc=0.6)
ANYWHERE_PX = 1e9


def texture(seed=0, shape=(60, 80)):
    rough = np.random.default_rng(seed).integers(60, 160, shape, dtype=np.uint8)
    return cv2.GaussianBlur(rough, (0, 0), 1.0)


def spots(count, seed=0, shape=(60, 80)):
    rng = np.random.default_rng(seed)
    return rng.uniform([R, R], [shape[1] - 1 - R, shape[0] - 1 - R], (count, 2))


def brute_zncc(image_a, pixel_a, image_b, pixel_b):
    """Of two patches, by the textbook: covariance over the product of standard deviations."""
    patches = []
    for image, (u, v) in ((image_a, pixel_a), (image_b, pixel_b)):
        u, v = round(u), round(v)
        patches.append(image[v - R : v + R + 1, u - R : u + R + 1].astype(float).ravel())
    return np.corrcoef(*patches)[0, 1]


def brute_mutual(scores, near, least):
    """Pair each of a with its best neighbour, if that one's best neighbour is a."""
    pairs = []
    for a in range(len(scores)):
        candidates = [b for b in range(scores.shape[1]) if near[a, b]]
        if not candidates:
            continue
        b = max(candidates, key=lambda b: scores[a, b])
        others = [k for k in range(len(scores)) if near[k, b]]
        if max(others, key=lambda k: scores[k, b]) == a and scores[a, b] > least:
            pairs.append((a, b))
    return pairs


def unit_vectors(rng, count, size=6):
    x = rng.normal(size=(count, size))
    return (x / np.linalg.norm(x, axis=1, keepdims=True)).astype(np.float32)


def test_describe_products_equal_zncc():
    a, b = texture(0), texture(1)
    pixels_a, pixels_b = spots(12, 0), spots(15, 1)
    vectors_a, vectors_b = describe(a, pixels_a, PATCH_PX), describe(b, pixels_b, PATCH_PX)
    assert vectors_a.shape == (12, PATCH_PX**2)
    expected = [[brute_zncc(a, p, b, q) for q in pixels_b] for p in pixels_a]
    np.testing.assert_allclose(vectors_a @ vectors_b.T, expected, atol=1e-5)


@given(gain=st.floats(0.4, 1.5), offset=st.floats(-15, 15), seed=st.integers(0, 99))
def test_describe_gain_and_offset_do_not_matter(gain, offset, seed):
    image, pixels = texture(seed), spots(10, seed)
    darker = np.round(gain * image + offset).clip(0, 255).astype(np.uint8)
    product = describe(image, pixels, PATCH_PX) * describe(darker, pixels, PATCH_PX)
    assert product.sum(axis=1).min() > 0.98  # not 1: grey levels are rounded


def test_describe_gives_zero_mean_and_unit_norm():
    vectors = describe(texture(), spots(30), PATCH_PX)
    assert np.abs(vectors.mean(axis=1)).max() < 1e-6
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)


def test_match_flat_or_cut_off_patches_match_nothing():
    image = texture()
    image[20:40, 20:40] = 77
    width, height = image.shape[::-1]
    flat = [[30.0, 30.0]]
    cut_off = [[R - 1, 30], [60, R - 1], [width - R, 30], [60, height - R], [-50, 30], [60, 999]]
    whole = [[R, R], [width - 1 - R, height - 1 - R]]
    vectors = describe(image, np.array(flat + cut_off + whole), PATCH_PX)
    assert not vectors[:-2].any()
    assert vectors[-2:].any(axis=1).all()
    pixels = np.zeros((len(vectors), 2))
    pairs = match_mutual(vectors, pixels, vectors, pixels, ANYWHERE_PX, SETTINGS)
    assert pairs.tolist() == [[7, 7], [8, 8]]


def test_describe_noise_of_one_grey_level_is_flat():
    nearly = 100 + np.random.default_rng(0).integers(0, 2, (40, 40), dtype=np.uint8)
    assert not describe(nearly, np.array([[20.0, 20.0]]), PATCH_PX).any()


@given(
    seed=st.integers(0, 10**6),
    count_a=st.integers(0, 12),
    count_b=st.integers(0, 12),
    radius_px=st.floats(1, 60),
    least=st.floats(0.05, 0.9),
)
def test_match_mutual_equals_double_loop(seed, count_a, count_b, radius_px, least):
    rng = np.random.default_rng(seed)
    a, b = unit_vectors(rng, count_a), unit_vectors(rng, count_b)
    expected_a, pixels_b = rng.uniform(0, 60, (count_a, 2)), rng.uniform(0, 60, (count_b, 2))
    pairs = match_mutual(a, expected_a, b, pixels_b, radius_px, MatchingSettings(min_zncc=least))
    near = np.abs(expected_a[:, None] - pixels_b[None]).max(axis=-1) < radius_px
    assert [tuple(pair) for pair in pairs.tolist()] == brute_mutual(a @ b.T, near, least)
    assert pairs.shape == (len(pairs), 2)
    assert len(set(pairs[:, 1].tolist())) == len(pairs)


def test_match_mutual_hand_worked():
    """0 and 1 of a are nearest to 0 of b, whose nearest is 1: 0 has no match, though 1 is free."""
    a = np.array([[1.0, 0, 0], [0.96, 0.28, 0], [0, 0, 1]])
    b = np.array([[0.96, 0.28, 0], [0.6, 0, 0.8]])
    here = np.zeros((3, 2))
    assert match_mutual(a, here, b, here[:2], 1.0, SETTINGS).tolist() == [[1, 0], [2, 1]]


def test_match_mutual_of_equal_features_takes_first():
    one, two = np.eye(1, 9, dtype=np.float32), np.tile(np.eye(1, 9, dtype=np.float32), (2, 1))
    for rows in ([12.0, 8.0], [8.0, 12.0]):
        pixels_b = np.column_stack([[10.0, 10.0], rows])
        assert match_mutual(
            one, np.array([[10.0, 10.0]]), two, pixels_b, 5.0, SETTINGS
        ).tolist() == [[0, 0]]


def test_match_mutual_window_is_square():
    a = unit_vectors(np.random.default_rng(0), 1)
    expected = np.array([[100.0, 50.0]])
    for offset, inside in (((9.9, 9.9), True), ((10.1, 0), False), ((0, -10.1), False)):
        pairs = match_mutual(a, expected, a, expected + offset, 10.0, SETTINGS)
        assert len(pairs) == inside
    # A perfect twin outside the window does not spoil a good match within it either.
    good = np.array([a[0] + [0.3, 0, 0, 0, 0, 0]])
    good /= np.linalg.norm(good)
    both = np.concatenate([a, good]).astype(np.float32)
    pixels = np.array([[300.0, 50.0], [101.0, 50.0]])
    assert match_mutual(a, expected, both, pixels, 10.0, SETTINGS).tolist() == [[0, 1]]


def test_match_mutual_nan_expectation_matches_nothing():
    a = unit_vectors(np.random.default_rng(0), 3)
    pixels = np.zeros((3, 2))
    expected = np.array([[0, 0], [np.nan, np.nan], [0, np.nan]])
    assert match_mutual(a, expected, a, pixels, 5.0, SETTINGS).tolist() == [[0, 0]]


@pytest.mark.parametrize(("count_a", "count_b"), [(0, 0), (0, 4), (4, 0)])
def test_match_mutual_without_features_is_empty(count_a, count_b):
    image = texture()
    a, b = (describe(image, spots(n), PATCH_PX) for n in (count_a, count_b))
    pairs = match_mutual(a, spots(count_a), b, spots(count_b), 9.0, SETTINGS)
    assert pairs.shape == (0, 2)


def test_match_mutual_moved_image_is_matched():
    """Every patch finds itself 7 px to the right and 3 px up."""
    image = texture(shape=(80, 120))
    moved = np.roll(image, (-3, 7), axis=(0, 1))
    rng = np.random.default_rng(0)
    u, v = np.meshgrid(np.arange(15, 100, 6), np.arange(12, 70, 6))
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    shuffled = rng.permutation(len(pixels))
    pairs = match_mutual(
        describe(image, pixels, PATCH_PX),
        pixels,
        describe(moved, pixels[shuffled] + [7, -3], PATCH_PX),
        pixels[shuffled] + [7, -3],
        12.0,
        SETTINGS,
    )
    assert len(pairs) == len(pixels)
    np.testing.assert_array_equal(shuffled[pairs[:, 1]], pairs[:, 0])
