"""Alignment on textures known between the pixels, and against OpenCV's."""

from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vo.patches.alignment import align
from vo.patches.templates import extract_templates

PATCH_PX = 17
SIZE = (140, 120)
"""(W, H) of every image here."""
CENTRES = np.array([[40.3, 35.8], [70.0, 60.0], [95.6, 80.1], [52.5, 84.5], [100.2, 40.7]])
SHARP_PX = 0.02


STILL = np.eye(3, 2)
"""The warp that changes nothing."""


class Texture:
    """A sum of waves of 9 to 40 px, whose grey level is known everywhere."""

    def __init__(self, seed=0, waves=16):
        rng = np.random.default_rng(seed)
        angle, length_px = rng.uniform(0, 2 * np.pi, waves), rng.uniform(9, 40, waves)
        self._k = 2 * np.pi / length_px * np.stack([np.cos(angle), np.sin(angle)])
        self._phase = rng.uniform(0, 2 * np.pi, waves)

    def image(self, warp=STILL, origin=(0, 0), target=(0, 0), gain=1.0, offset=0.0):
        """The texture after a projective map that carries `origin` to `target`."""
        u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
        after = np.stack([u - target[0], v - target[1], np.ones(SIZE[::-1])], axis=-1)
        before = after @ np.linalg.inv(np.column_stack([warp, [0, 0, 1]])).T
        points = before[..., :2] / before[..., 2:] + origin
        grey = 128 + 10 * np.cos(points @ self._k + self._phase).sum(axis=-1)
        return np.round(gain * grey + offset).clip(0, 255).astype(np.uint8)


@cache
def plain(seed):
    return Texture(seed).image()


def each(warp, count=1):
    return np.tile(np.asarray(warp, dtype=float), (count, 1, 1))


PLAIN = each(STILL, len(CENTRES))


def find(template, pixels, image, start, warp, horizontal_only=False):
    """Cut and align: the places and their correlation."""
    found = align(
        extract_templates(template, pixels, PATCH_PX), image, start, warp, horizontal_only
    )
    assert (np.isnan(found.covariance_px2).all(axis=(1, 2)) == np.isnan(found.zncc)).all()
    return found.pixels, found.zncc


def assert_near(aligned, expected):
    error_px = np.linalg.norm(aligned - expected, axis=1)
    assert np.median(error_px) < SHARP_PX
    assert error_px.max() < 5 * SHARP_PX  # where waves cancel, rounding to grey levels weighs more


@settings(deadline=None, max_examples=25)
@given(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)).map(np.array), st.integers(0, 5))
def test_align_recovers_shift(shift, seed):
    texture = Texture(seed)
    image = texture.image(target=shift)
    aligned, zncc = find(texture.image(), CENTRES, image, CENTRES, PLAIN)
    assert_near(aligned, CENTRES + shift)
    assert zncc.min() > 0.999


def test_align_error_is_small_not_zero():
    rng = np.random.default_rng(1)
    errors = []
    for seed in range(30):
        texture, shift = Texture(seed), rng.uniform(-1.5, 1.5, 2)
        image = texture.image(target=shift)
        aligned, _ = find(texture.image(), CENTRES, image, CENTRES, PLAIN)
        errors.append(aligned - CENTRES - shift)
    rmse = np.sqrt(np.mean(np.square(errors)))
    assert 1e-4 < rmse < SHARP_PX / 2
    assert np.abs(np.mean(errors, axis=(0, 1))).max() < 0.003


WARPS = {
    "larger": [[1.25, 0], [0, 1.25], [0, 0]],
    "smaller": [[0.8, 0], [0, 0.8], [0, 0]],
    "turned": [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)], [0, 0]],
    "sheared": [[1.0, 0.3], [0, 1], [0, 0]],
    "tilted": [[1.0, 0], [0, 1], [0.006, -0.008]],
    "everything": [[0.85, -0.15], [0.1, 1.1], [-0.004, 0.006]],
}


@pytest.mark.parametrize("warp", WARPS.values(), ids=WARPS)
def test_align_under_known_warp_recovers_position(warp):
    for seed, centre in enumerate(CENTRES):
        texture, target = Texture(seed), np.array([68.4, 57.7])
        template, image = plain(seed), texture.image(warp, centre, target)
        start = (target + np.array([0.8, -1.1]))[None]
        aligned, zncc = find(template, centre[None], image, start, each(warp))
        assert np.abs(aligned - target).max() < 1.5 * SHARP_PX
        assert zncc[0] > 0.999
        _, unaware = find(template, centre[None], image, start, each(STILL))
        assert not unaware[0] > zncc[0]  # NaN where it is lost


@settings(deadline=None, max_examples=20, derandomize=True)
@given(gain=st.floats(0.6, 1.0), offset=st.floats(-20, 20))
def test_align_gain_and_offset_do_not_matter(gain, offset):
    """With less gain, the rounding of grey levels would."""
    texture, shift = Texture(2), np.array([0.6, -0.9])
    image = texture.image(target=shift, gain=gain, offset=50 + offset)
    aligned, zncc = find(texture.image(), CENTRES, image, CENTRES, PLAIN)
    assert_near(aligned, CENTRES + shift)
    assert zncc.min() > 0.998


def test_align_zncc_equals_that_of_aligned_patches():
    texture, shift = Texture(3), np.array([2.0, -1.0])
    noise = np.random.default_rng(0).normal(scale=25, size=SIZE[::-1])
    template = texture.image()
    image = (texture.image(target=shift) + noise).clip(0, 255).astype(np.uint8)
    centre = np.array([[60.0, 50.0]])
    aligned, zncc = find(template, centre, image, centre + shift, each(STILL))
    size = (PATCH_PX, PATCH_PX)
    patches = [
        cv2.getRectSubPix(x.astype(np.float32), size, tuple(map(float, place)))
        for x, place in ((template, centre[0]), (image, aligned[0]))
    ]
    assert 0.5 < zncc[0] < 0.97
    assert zncc[0] == pytest.approx(np.corrcoef(*(p.ravel() for p in patches))[0, 1], abs=1e-3)


def test_align_equals_opencv():
    """The enhanced correlation coefficient of Evangelidis and Psarakis, translation only."""
    shift = np.array([0.7, -0.4])
    for seed in range(4):
        texture = Texture(seed)
        template, image = texture.image(), texture.image(target=shift)
        centres = np.round(CENTRES)
        aligned, _ = find(template, centres, image, centres, PLAIN)
        for (u, v), ours in zip(centres.astype(int), aligned, strict=True):
            r = PATCH_PX // 2
            patch = template[v - r : v + r + 1, u - r : u + r + 1]
            warp = np.array([[1, 0, u - r], [0, 1, v - r]], dtype=np.float32)
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-6)
            _, warp = cv2.findTransformECC(
                patch, image, warp, cv2.MOTION_TRANSLATION, criteria, None, 1
            )
            assert np.abs(ours - (warp[:, 2] + r)).max() < SHARP_PX


def test_align_horizontal_stays_on_row():
    texture, shift = Texture(4), np.array([1.2, 0.0])
    template, image = texture.image(), texture.image(target=shift)
    aligned, _ = find(template, CENTRES, image, CENTRES, PLAIN, horizontal_only=True)
    np.testing.assert_array_equal(aligned[:, 1], CENTRES[:, 1])
    assert np.abs(aligned[:, 0] - CENTRES[:, 0] - shift[0]).max() < SHARP_PX


def test_align_horizontal_needs_no_vertical_texture():
    """Upright stripes determine the shift along the row, but not in two dimensions."""
    stripes = np.round(128 + 60 * np.cos(np.arange(SIZE[0]) / 3)).astype(np.uint8)
    image = np.tile(stripes, (SIZE[1], 1))
    start = CENTRES + np.array([0.8, 0])
    along, zncc = find(image, CENTRES, image, start, PLAIN, horizontal_only=True)
    assert np.abs(along - CENTRES).max() < SHARP_PX
    assert zncc.min() > 0.999
    anywhere, _ = find(image, CENTRES, image, start, PLAIN)
    assert np.isnan(anywhere).all()


def test_align_outside_or_flat_gives_nan():
    texture = Texture(5)
    image, flat = texture.image(), np.full(SIZE[::-1], 90, np.uint8)
    inside, reach = np.array([[70.0, 60.0]]), PATCH_PX // 2
    edges = [[reach - 1, 60], [SIZE[0] - reach, 60], [70, reach - 1], [70, SIZE[1] - reach]]
    cases = [(image, [edge], image, inside) for edge in edges]
    cases += [(image, inside, image, [edge]) for edge in edges]
    cases += [(flat, inside, image, inside), (image, inside, flat, inside)]
    cases += [(image, inside, image, [[np.nan, 60]]), (image, [[70, np.nan]], image, inside)]
    cases += [(image, inside, image, [[1e6, 60]]), (image, inside, image, [[-1e6, 60]])]
    for template, pixels, other, start in cases:
        aligned, zncc = find(template, np.asarray(pixels), other, np.asarray(start), each(STILL))
        assert np.isnan(aligned).all()
        assert np.isnan(zncc).all()
    aligned, _ = find(image, inside, image, inside, each(np.full((3, 2), np.nan)))
    assert np.isnan(aligned).all()


def test_align_unrelated_texture_stays_near_start():
    """Unrelated texture: the result stays within half a patch of the start, or there is none."""
    a, b = Texture(6).image(), Texture(7).image()
    aligned, zncc = find(a, CENTRES, b, CENTRES, PLAIN)
    moved = np.abs(aligned - CENTRES)[~np.isnan(zncc)]
    assert (moved <= PATCH_PX // 2).all()
    assert not (zncc > 0.95).any()


def test_align_bad_patch_leaves_others_unchanged():
    texture, shift = Texture(8), np.array([0.5, 0.5])
    image = texture.image(target=shift)
    mixed = CENTRES.copy()
    mixed[2] = np.nan
    alone, _ = find(texture.image(), CENTRES, image, CENTRES, PLAIN)
    together, _ = find(texture.image(), mixed, image, mixed, PLAIN)
    good = [0, 1, 3, 4]
    np.testing.assert_array_equal(together[good], alone[good])
    assert np.isnan(together[2]).all()


def test_align_without_patches_gives_empty_arrays():
    none = np.zeros((0, 2))
    aligned, zncc = find(Texture().image(), none, Texture().image(), none, np.zeros((0, 3, 2)))
    assert aligned.shape == (0, 2)
    assert zncc.shape == (0,)


@pytest.mark.parametrize("whole", [True, False], ids=["whole pixels", "between pixels"])
@pytest.mark.parametrize("along_row", [True, False])
@pytest.mark.parametrize("warp", [STILL, WARPS["everything"]], ids=["still", "warped"])
def test_align_covariance_matches_errors_by_noise(warp, along_row, whole):
    """Normalised errors under known noise have unit variance, in both directions together too."""
    rng, normalised = np.random.default_rng(0), []
    for seed in range(60):
        texture = Texture(seed)
        centre, target = (np.round(x) + (0 if whole else rng.uniform(-0.5, 0.5, 2)) for x in
                          (CENTRES[seed % 5], np.array([68.4, 57.7])))  # fmt: skip
        images = (plain(seed), texture.image(warp, centre, target))
        noisy = [np.round(x + rng.normal(scale=4, size=x.shape)).clip(0, 255) for x in images]
        template, image = (x.astype(np.uint8) for x in noisy)
        templates = extract_templates(template, centre[None], PATCH_PX)
        found = align(templates, image, target[None], each(warp), horizontal_only=along_row)
        error, covariance = found.pixels[0] - target, found.covariance_px2[0]
        if along_row:
            normalised.append(error[0] ** 2 / covariance[0, 0])
        else:
            normalised.append(error @ np.linalg.solve(covariance, error) / 2)
    assert 0.6 < np.mean(normalised) < 1.5


def test_templates_are_normalised_and_differentiated():
    image = Texture(3).image()
    templates = extract_templates(image, CENTRES, 9)
    patches, (gu, gv) = templates.patches, templates.gradients.swapaxes(0, 1)
    assert np.abs(patches.sum(axis=(1, 2))).max() < 1e-4
    np.testing.assert_allclose((patches**2).sum(axis=(1, 2)), 1, rtol=1e-5)
    for axis, ours in ((0, gu), (1, gv)):
        step = np.eye(2)[axis] * 0.5
        ahead, behind = (extract_templates(image, CENTRES + s * step, 9) for s in (1, -1))
        numeric = ahead.patches - behind.patches
        assert np.corrcoef(numeric.ravel(), ours.ravel())[0, 1] > 0.999
        assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(numeric), rel=0.05)
    np.testing.assert_array_equal(
        extract_templates(image, np.array([[1.0, 50], [np.nan, 50]]), 9).norms, 0
    )
