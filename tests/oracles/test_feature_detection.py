"""Features, descriptors and softness against slow implementations of the same definitions."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vo.config import FeatureSettings
from vo.features.censure import _pass_rows, censure
from vo.features.censure_kernels import SHAPES, kernels
from vo.features.detector import detect
from vo.features.image_quality import (
    FAR_PX,
    LINE_STEP,
    NEAR_PX,
    NEXT_PX,
    measure_image_quality,
)
from vo.patches.zncc import MIN_CONTRAST, describe

KERNELS = tuple(SHAPES)


def region_mask(region):
    size = max(m + 2 * n for _, m, n in region)
    y, x = np.abs(np.mgrid[:size, :size] - size // 2)
    return sum(
        sign * ((np.maximum(x, y) <= m // 2 + n) & (x + y <= m - 1 + n)) for sign, m, n in region
    ).astype(float)


def slow_responses(image, kernel):
    weights = kernels(kernel).weights
    responses = []
    for regions, factors in zip(SHAPES[kernel], weights, strict=True):
        sums = (
            cv2.filter2D(
                image.astype(float), cv2.CV_64F, region_mask(x), borderType=cv2.BORDER_CONSTANT
            )
            for x in regions
        )
        centre, whole = (np.rint(x).astype(np.float32) for x in sums)
        responses.append(centre * factors[0] + whole * factors[1])
    return np.array(responses)


def slow_vertex(near):
    du, dv = (near[1, 2] - near[1, 0]) / 2, (near[2, 1] - near[0, 1]) / 2
    uu = near[1, 2] + near[1, 0] - 2 * near[1, 1]
    vv = near[2, 1] + near[0, 1] - 2 * near[1, 1]
    uv = (near[2, 2] - near[2, 0] - near[0, 2] + near[0, 0]) / 4
    hessian = np.array([[uu, uv], [uv, vv]])
    if uu * vv <= uv * uv:
        hessian = np.diag([uu, vv])
    if np.linalg.det(hessian) == 0:
        return np.zeros(2)
    return np.clip(-np.linalg.solve(hessian, [du, dv]), -0.5, 0.5)


def slow_candidates(image, s):
    """Rows (u_px, v_px, response, u, v, scale) of all extrema, by scale, row and column."""
    responses, margin = slow_responses(image, s.kernel), kernels(s.kernel).margin
    found = []
    for k in range(1, len(responses) - 1):
        edge = margin[k + 1] + 1
        for v in range(edge, image.shape[0] - edge):
            for u in range(edge, image.shape[1] - edge):
                value = responses[k, v, u]
                if abs(value) <= np.float32(s.threshold):
                    continue
                near = responses[k - 1 : k + 2, v - 1 : v + 2, u - 1 : u + 2]
                around = (np.sign(value) * near).ravel()
                if (around[:13] < abs(value)).all() and (around[14:] <= abs(value)).all():
                    du, dv = slow_vertex(near[1].astype(float))
                    found.append((u + du, v + dv, value, u, v, k))
    return found


def slow_corner(image, u, v, reach, max_ratio):
    """Of equal gradients in all directions, or nearly: by the eigenvalues' ratio."""
    grey = image.astype(float)
    du, dv = np.zeros_like(grey), np.zeros_like(grey)
    du[1:-1, 1:-1] = grey[1:-1, 2:] - grey[1:-1, :-2]
    dv[1:-1, 1:-1] = grey[2:, 1:-1] - grey[:-2, 1:-1]
    inside = slice(max(v - reach, 0), v + reach + 1), slice(max(u - reach, 0), u + reach + 1)
    g = np.stack([du[inside].ravel(), dv[inside].ravel()])
    trace, determinant = np.trace(g @ g.T), np.round(np.linalg.det(g @ g.T))
    return trace**2 < (max_ratio + 1) ** 2 / max_ratio * determinant


def slow_detect(image, s):
    reach = kernels(s.kernel).window_px
    corners = [
        x for x in slow_candidates(image, s)
        if slow_corner(image, *x[3:5], reach[x[5]], s.line_ratio)
    ]  # fmt: skip
    corners.sort(key=lambda x: -abs(x[2]))  # stable
    taken, ranked = {}, []
    for order, x in enumerate(corners):
        cell = x[0] // s.cell_px, x[1] // s.cell_px
        ranked.append((taken.get(cell, 0), order))
        taken[cell] = taken.get(cell, 0) + 1
    chosen = sorted(order for _, order in sorted(ranked)[: s.count])
    return np.array([corners[i][:2] for i in chosen]).reshape(-1, 2)


def texture(shape, seed, levels, blur):
    """Noise of some grey levels: few of them make many equal responses."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, levels, shape).astype(float)
    if blur:
        image = cv2.GaussianBlur(image, (0, 0), blur)
    return np.round(cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX)).astype(np.uint8)


@settings(deadline=None, max_examples=25)
@given(
    height=st.integers(1, 75),
    width=st.integers(1, 90),
    seed=st.integers(0, 99),
    levels=st.sampled_from([2, 3, 256]),
    blur=st.sampled_from([0, 1.5]),
    kernel=st.sampled_from(KERNELS),
    threshold=st.sampled_from([0.0, 0.5, 4.0]),
    count=st.sampled_from([5, 10**6]),
    line_ratio=st.sampled_from([1.2, 12.0]),
)
def test_detect_equals_slow_search(height, width, seed, levels, blur, **changed):
    image = texture((height, width), seed, levels, blur)
    s = FeatureSettings(cell_px=17, **changed)
    np.testing.assert_allclose(detect(image, s), slow_detect(image, s), atol=1e-6)


@pytest.mark.parametrize("kernel", KERNELS)
def test_detect_repeated_pattern_equals_slow_search(kernel):
    """Every response occurs many times; of equal strength, the first in the image is taken."""
    image = np.tile(texture((9, 11), 3, 256, 0), (8, 8))
    s = FeatureSettings(kernel=kernel, threshold=1.0, count=40, cell_px=24)
    expected = slow_detect(image, s)
    assert len(expected) > 20
    np.testing.assert_allclose(detect(image, s), expected, atol=1e-6)


def test_censure_of_dots_finds_all_of_many_extrema():
    """More than space was allocated for."""
    image = np.zeros((60, 80), np.uint8)
    image[::4, ::4] = 255
    s = FeatureSettings(kernel="box", threshold=0.0)
    expected = slow_candidates(image, s)
    assert max(np.bincount([x[5] for x in expected])) > image.size // 16
    np.testing.assert_allclose(censure(image, s)[:, :5], [x[:5] for x in expected], atol=1e-6)


def test_detect_views_and_read_only_images_share_machine_code():
    image = texture((60, 70), 0, 256, 1.5)
    expected = detect(image, FeatureSettings())
    assert len(expected) > 10
    before = [*_pass_rows.signatures]
    frozen = image.copy()
    frozen.flags.writeable = False
    for same in (frozen, np.hstack([image, image])[:, :70], np.asfortranarray(image)):
        np.testing.assert_array_equal(detect(same, FeatureSettings()), expected)
    assert _pass_rows.signatures == before


@pytest.mark.parametrize("patch_px", [5, 13])
def test_describe_equals_slow_normalisation(patch_px):
    image = texture((40, 53), 0, 256, 1.5)
    image[:20, :20] = 77
    pixels = np.random.default_rng(0).uniform(-5, 58, (60, 2))
    r, expected = patch_px // 2, np.zeros((60, patch_px**2))
    for row, (u, v) in zip(expected, np.rint(pixels).astype(int), strict=True):
        if min(u, v) >= r and u < 53 - r and v < 40 - r:
            patch = image[v - r : v + r + 1, u - r : u + r + 1].astype(float)
            if patch.std() > MIN_CONTRAST:
                row[:] = (patch - patch.mean()).ravel() / np.linalg.norm(patch - patch.mean())
    assert 5 < np.any(expected, axis=1).sum() < 50
    np.testing.assert_allclose(describe(image, pixels, patch_px), expected, atol=1e-6)


@pytest.mark.parametrize("shape", [(18, 18), (41, 67)])
def test_softness_equals_mean_of_differences(shape):
    image = texture(shape, 0, 256, 1.5)
    quality = measure_image_quality(image)
    softness, smear = [], []
    for lines in (image[::LINE_STEP], image.T[::LINE_STEP]):
        next_, near, far = (
            np.mean((lines[:, d:].astype(float) - lines[:, :-d]) ** 2)
            for d in (NEXT_PX, NEAR_PX, FAR_PX)
        )
        smear.append((far - 2 * quality.noise**2) / (near - 2 * quality.noise**2))
        softness.append(max(1 + 3 / 4 * (far - near) / (near - next_), smear[-1]))
    assert quality.softness == pytest.approx(min(softness), rel=1e-12)
    assert quality.smear == pytest.approx(max(smear), rel=1e-12)
