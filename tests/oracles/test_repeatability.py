"""Repeatability of the detector on real photographs, by two protocols.

Positions: of the features of both images that lie in their common part, a pair repeats if each is
the other's nearest after mapping by the known homography, and they lie within `REACH_PX`.

Regions, after Mikolajczyk et al., IJCV 2005, as OpenCV's evaluation of detectors does it: features
are discs that the homography turns into ellipses; those that lie in both images whole are
compared. Each pair is magnified until the first disc has a radius of 30 px (their distance is
not), and pairs that share at least 60 % of their union are assigned to each other, greedily, each
once. Both shares refer to the smaller count. This is the protocol of STAR's figures: OpenCV 5's
STAR with maxSize = 16 reaches 64, 46, 24 (graf) and 71, 64, 56, 47, 43 (bikes) by the code below.

Features are not bucketed into cells, for that would choose different ones in each image. For
positions the threshold is fixed; for regions, where many features help by chance, it is the one
that gives as many features in the first image as STAR finds.
"""

from functools import cache

import cv2
import numpy as np
import pytest
from scale_space import scale_space
from scipy.spatial import KDTree

from vo.config import FeatureSettings
from vo.features.candidates import select_corners
from vo.features.censure import censure
from vo.features.censure_kernels import kernels
from vo.features.detector import detect

REACH_PX = 2.5
MIN_OVERLAP = 0.6
RADIUS_PX = 30
SETTINGS = FeatureSettings(count=10**6, threshold=60.0, cell_px=10**6)

# Positions, reached when written, %, images 1 -> 2 ... 6:
# graf 58, 46, 39, 34, 32; bikes 82, 80, 76, 67, 52. STAR, maxSize = 16, at its own threshold:
# graf 55, 41, 39, 33, 32; bikes 74, 72, 66, 60, 52.
MIN_PERCENT = {"graf": (54, 42, 35, 30, 28), "bikes": (77, 75, 70, 60, 42)}

# Regions: what is published of OpenCV's STAR, and how many features that finds in image 1.
# graf 1 -> 5 and 6: circles and ellipses overlap too little, none repeat.
STAR = {"graf": (63.4, 45.4, 26.2), "bikes": (70.7, 62.8, 55.2, 41.3, 41.7)}
STAR_COUNT = {"graf": 824, "bikes": 489}
SHORT = {"box": 0, "octagon": 0, "star": 1}
"""By how much a kernel may fall short: our star has 25.7 on graf 1 -> 4."""


@pytest.fixture(scope="module")
def series(real_data):
    """The six images of a series and the homographies 1 -> 2 ... 6."""

    def load(name):
        folder = real_data("affine") / name
        images = [cv2.imread(str(folder / f"img{k}.png"), 0) for k in range(1, 7)]
        return images, [homography(folder, k) for k in range(2, 7)]

    return load


def homography(folder, k):
    file = cv2.FileStorage(str(folder / f"H1to{k}p.xml"), cv2.FILE_STORAGE_READ)
    return file.getFirstTopLevelNode().mat()


def moved(offset_px):
    H = np.eye(3)
    H[:2, 2] = offset_px
    return H


def carry(H, pixels):
    homogeneous = np.column_stack([pixels, np.ones(len(pixels))]) @ H.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def inside(pixels, size):
    return ((pixels >= 0) & (pixels <= np.array(size) - 1)).all(axis=1)


def share(first, other, H, size):
    carried = carry(H, first)
    carried = carried[inside(carried, size)]
    other = other[inside(carry(np.linalg.inv(H), other), size)]
    distance, nearest = KDTree(other).query(carried)
    _, back = KDTree(carried).query(other)
    mutual = back[nearest] == np.arange(len(carried))
    return 100 * (mutual & (distance < REACH_PX)).sum() / min(len(carried), len(other))


def vertex(before, here, after):
    """Offset of the vertex of the parabola through three samples."""
    return ((before - after) / 2 / (before - 2 * here + after)).clip(-0.5, 0.5)


@cache
def blob_scales(kernel):
    """Scale, interpolated, at which Gaussian blobs have their extremum, and their sigmas."""
    y, x = np.mgrid[-45:46, -45:46]
    sigmas = np.geomspace(0.5, 20, 200)
    bumps = (100 + 150 * np.exp((x**2 + y**2) / (-2 * sigma**2)) for sigma in sigmas)
    shape = kernels(kernel)
    responses = np.stack(
        [scale_space(np.round(bump).astype(np.uint8), shape)[:, 45, 45] for bump in bumps], axis=1
    )
    best = responses.argmax(axis=0)
    inner = np.flatnonzero((best > 0) & (best < len(responses) - 1))
    best = best[inner]
    offset = vertex(*(responses[best + i, inner] for i in (-1, 0, 1)))
    order = np.argsort(best + offset)
    return (best + offset)[order], sigmas[inner][order]


def strongest_first(image, settings):
    return select_corners(censure(image, settings), image, settings)[:, :3]


def discs(image, settings):
    """Strongest first: centres, and shapes C of x' inv(C) x < 1, of blobs to their inflexion."""
    found = strongest_first(image, settings)
    responses = scale_space(image, kernels(settings.kernel))
    scales = []
    for u, v, response in found:
        column, row = round(u) - 1, round(v) - 1  # the extremum lies up to half a pixel away
        near = responses[:, row : row + 3, column : column + 3]
        s, j, i = np.argwhere(near == np.float32(response))[0]
        s = min(max(s, 1), len(responses) - 2)
        scales.append(s + vertex(*near[s - 1 : s + 2, j, i]))
    sigma = np.interp(scales, *blob_scales(settings.kernel))
    return found[:, :2], 2 * sigma[:, None, None] ** 2 * np.eye(2)


def carry_regions(H, centres, shapes):
    """Ellipses by the homography's first order about each centre."""
    homogeneous = np.column_stack([centres, np.ones(len(centres))]) @ H.T
    there, depth = homogeneous[:, :2] / homogeneous[:, 2:], homogeneous[:, 2, None, None]
    slope = (H[:2, :2] - there[:, :, None] * H[2, :2]) / depth
    return there, slope @ shapes @ slope.transpose(0, 2, 1)


def whole(centres, shapes, size):
    reach = np.sqrt(np.diagonal(shapes, axis1=1, axis2=2))
    return ((centres > reach) & (centres + reach < size)).all(axis=1)


def overlap(shape, others, offsets):
    """Share of the union that an ellipse at the origin and each of others have in common."""
    reach = np.sqrt(np.diag(shape))
    grid = np.stack(np.meshgrid(*(np.arange(-r, r + 1) for r in reach)), axis=-1).reshape(-1, 2)
    grid = grid[np.einsum("ni,ij,nj->n", grid, np.linalg.inv(shape), grid) < 1]
    x = grid - offsets[:, None]
    shared = (np.einsum("mni,mij,mnj->mn", x, np.linalg.inv(others), x) < 1).sum(axis=1)
    union = np.pi * (np.sqrt(np.linalg.det(shape)) + np.sqrt(np.linalg.det(others))) - shared
    return shared / union


def region_share(discs_1, discs_2, H, size):
    there, back = carry_regions(H, *discs_1), carry_regions(np.linalg.inv(H), *discs_2)
    common = [whole(*a, size) & whole(*b, size) for a, b in ((discs_1, there), (discs_2, back))]
    (centres, shapes), (others, other_shapes) = (
        [part[kept] for part in region]
        for region, kept in zip((discs_1, back), common, strict=True)
    )
    area = np.sqrt(np.linalg.det(other_shapes))
    tree, pairs = KDTree(others), []
    for i, (centre, shape) in enumerate(zip(centres, shapes, strict=True)):
        near = np.array(tree.query_ball_point(centre, 4 * np.sqrt(shape[0, 0])), dtype=int)
        ratio = area[near] / shape[0, 0]
        near = near[(ratio > MIN_OVERLAP) & (ratio < 1 / MIN_OVERLAP)]  # no other could reach
        if len(near):
            zoom = RADIUS_PX**2 / shape[0, 0]
            shared = overlap(zoom * shape, zoom * other_shapes[near], others[near] - centre)
            pairs += [(x, i, j) for x, j in zip(shared, near, strict=True) if x > MIN_OVERLAP]
    taken_1, taken_2 = set(), set()
    for _, i, j in sorted(pairs, reverse=True):
        if i not in taken_1 and j not in taken_2:
            taken_1.add(i)
            taken_2.add(j)
    return 100 * len(taken_1) / min(len(centres), len(others))


def by_positions(images, maps):
    first, *others = (detect(image, SETTINGS) for image in images)
    size = images[0].shape[::-1]
    return np.array([share(first, x, H, size) for x, H in zip(others, maps, strict=True)])


def by_regions(images, maps, kernel, count):
    settings = SETTINGS.model_copy(update={"kernel": kernel, "threshold": 0.0})
    strength = np.abs(strongest_first(images[0], settings)[:, 2])
    settings = settings.model_copy(update={"threshold": strength[count]})
    first, *others = (discs(image, settings) for image in images)
    assert len(first[0]) == count
    size = images[0].shape[::-1]
    return np.array([region_share(first, x, H, size) for x, H in zip(others, maps, strict=True)])


def report(name, percent):
    return f"{name}: {', '.join(f'{x:.1f}' for x in percent)} %"


@pytest.mark.parametrize("name", ["graf", "bikes"])
def test_detect_positions_repeat(series, name):
    percent = by_positions(*series(name))
    assert (percent > MIN_PERCENT[name]).all(), report(name, percent)
    assert (percent < 95).all(), report(name, percent)  # blur and a turned wall do cost features


@pytest.mark.parametrize("kernel", SHORT)
@pytest.mark.parametrize("name", ["graf", "bikes"])
def test_censure_regions_repeat_as_much_as_star(series, name, kernel):
    images, maps = series(name)
    pairs = len(STAR[name])
    percent = by_regions(images[: pairs + 1], maps[:pairs], kernel, STAR_COUNT[name])
    assert (percent > np.array(STAR[name]) - SHORT[kernel]).all(), report(name, percent)
    assert (percent < 95).all(), report(name, percent)


def test_detect_wrong_homographies_repeat_little(series):
    """The repeatability of chance alone."""
    images, maps = series("graf")
    wrong = [np.array([[1, 0, 23], [0, 1, -17], [0, 0, 1]]) @ H for H in maps]
    percent = by_positions(images, wrong)
    assert (percent < 16).all(), report("positions", percent)
    percent = by_regions(images[:4], wrong[:3], "octagon", STAR_COUNT["graf"])
    assert (percent < (30, 20, 10)).all(), report("regions", percent)


def test_overlap_of_discs_equals_closed_form():
    radius, apart = 30.0, 11.0
    half_angle = np.arccos(apart / (2 * radius))
    lens = 2 * radius**2 * half_angle - apart * np.sqrt(radius**2 - apart**2 / 4)
    disc = radius**2 * np.eye(2)
    shared = overlap(disc, disc[None], np.array([[apart, 0.0]]))
    assert shared[0] == pytest.approx(lens / (2 * np.pi * radius**2 - lens), abs=0.005)
