"""Sharpness: the width of straight, isolated step edges, as a Gaussian standard deviation.

Profiles across edges in linear light are fitted with the integral of a Gaussian between two slopes,
as slanted edges are in ISO 12233; what is no step, such as lines and texture, is left out.

Source: van Zwanenberg, Triantaphillidou, Jenkin and Psarrou, Edge detection techniques for
quantifying spatial imaging system performance and image quality, CVPR workshops 2019.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.special import erf

from sim.imaging.resample import sample
from vo.contract.arrays import Array, Image

EDGES = 300
"""Largest number of edges of an image, the strongest."""
SMOOTHING_PX = 1.0
MIN_GRADIENT = 3.0
"""Smallest gradient of an edge in the smoothed image, grey levels per px."""
MARGIN_PX = 4
REACHES_PX = (6, 9, 14, 21)
"""Half lengths of profiles; one suffices for widths of a quarter of it."""
STEP_PX = 0.5
MAX_RESIDUAL, MAX_SLOPE, MAX_UNCERTAINTY, MAX_OFFSET_PX = 0.03, 0.5, 0.12, 1.5
"""Largest standard deviation of a profile about its fit, and light by the slopes, as shares of the
step; uncertainty of the width as a share of it; distance of the edge from where it was found."""
MIN_WIDTH_PX = 0.1
ALONG_PX = (-1.0, 0.0, 1.0)
"""Places along an edge whose profiles are averaged."""
ITERATIONS, SETTLED_PX = 15, 1e-4
"""Largest number of steps of a fit, which ends where place and width change by less."""
MIN_EDGES = 30
"""Smallest number of edges from which the width is estimated."""


def edge_profiles(grey: Image, light: Array) -> tuple[Array, ...]:
    """Return profiles (E, L) across the strongest edges of an image, for each of REACHES_PX.

    Args:
        grey: (H, W) uint8, in which edges are found.
        light: (H, W) float32 linear light of it, in which they are sampled.
    """
    points, normals = _find(grey)
    if not len(points):
        return no_profiles()
    found = [_profiles(light, points, normals, _distances(x)) for x in REACHES_PX]
    return tuple(x[np.isfinite(x).all(axis=1)] for x in found)


def edge_widths(frames: Sequence[tuple[Array, ...]]) -> list[Array]:
    """Return the widths (E,) of the step edges of each image, from their `edge_profiles`.

    They are standard deviations in px. Only short profiles fit between close edges, only long ones
    hold a wide edge: all are fitted at the shortest length that holds the edges of the recording.
    """
    tried: list[list[Array]] = []
    for k, reach_px in enumerate(REACHES_PX):
        tried.append([_step_widths(_distances(reach_px), x[k]) for x in frames])
        if edge_width(np.concatenate(tried[-1])) < reach_px / 4:
            return tried[-1]
    return tried[0]


def no_profiles() -> tuple[Array, ...]:
    """Return what an image without edges has."""
    return tuple(np.zeros((0, len(_distances(x)))) for x in REACHES_PX)


def _distances(reach_px: int) -> Array:
    """Return the distances (L,) from an edge at which profiles of a length are sampled, px."""
    return np.arange(-reach_px, reach_px + STEP_PX / 2, STEP_PX)


def _step_widths(at: Array, profiles: Array) -> Array:
    """Return the widths (E,) of the profiles (N, L) that are steps."""
    width_px, is_step = _fit(at, profiles)
    return width_px[is_step]


def edge_width(widths_px: Array) -> float:
    """Return the most frequent of the widths (E,): the middle of their shortest half; else NaN.

    Edges of soft things and of shadows are wider, thin things narrower than the image of a step.
    """
    count = len(widths_px)
    if count < MIN_EDGES:
        return np.nan
    ordered, half = np.sort(widths_px), count // 2
    k = int(np.argmin(ordered[half:] - ordered[: count - half]))
    return float(ordered[k] + ordered[k + half]) / 2


def _find(grey: Image) -> tuple[Array, Array]:
    """Return the places (E, 2) of the strongest edges, and their unit normals (E, 2), (u, v)."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTHING_PX)
    du, dv = (cv2.Sobel(smooth, cv2.CV_32F, *x, scale=1 / 8) for x in ((1, 0), (0, 1)))
    size = np.hypot(du, dv)
    peak = (size == cv2.dilate(size, np.ones((3, 3), np.uint8))) & (size > MIN_GRADIENT)
    m = MARGIN_PX
    inner = np.zeros_like(peak)
    inner[m:-m, m:-m] = peak[m:-m, m:-m]
    v, u = np.nonzero(inner)
    best = np.argsort(size[v, u])[::-1][:EDGES]
    v, u = v[best], u[best]
    normals = np.stack([du[v, u], dv[v, u]], axis=1) / size[v, u, None]
    return np.stack([u, v], axis=1).astype(np.float64), normals


def _profiles(light: Array, points: Array, normals: Array, at: Array) -> Array:
    """Sample light across edges at distances (L,): (E, L), NaN beyond the image."""
    along = normals[:, ::-1] * (-1, 1)
    across = points[:, None] + at[:, None] * normals[:, None]
    total = np.zeros((len(points), len(at)))
    for x in ALONG_PX:
        total += sample_inside(light, across + x * along[:, None])
    return total / len(ALONG_PX)


def sample_inside(image: Array, places: Array) -> Array:
    """Sample an image (H, W) float32 at places (N, L, 2), (u, v): (N, L), NaN beyond it."""
    size = np.array(image.shape[::-1])
    inside = ((places >= 0) & (places <= size - 1)).all(axis=-1, keepdims=True)
    u, v = np.moveaxis(np.where(inside, places, np.nan).astype(np.float32), -1, 0)
    return sample(image, np.ascontiguousarray(u), np.ascontiguousarray(v))


def _fit(at: Array, profiles: Array) -> tuple[Array, Array]:
    """Fit profiles (E, L) at distances (L,): width in px, and whether it is a step, (E,) each."""
    low, high = profiles[:, 0], profiles[:, -1]
    parts = np.zeros((6, len(low)))
    parts[0], parts[1], parts[3] = (low + high) / 2, (high - low) / 2, 1
    moving = np.arange(len(low))
    for _ in range(ITERATIONS):
        model, jacobian = _step(at, parts[:, moving])
        normal = jacobian @ np.swapaxes(jacobian, 1, 2) + 1e-9 * np.eye(6)
        wanted = jacobian @ (profiles[moving] - model)[..., None]
        change = np.linalg.solve(normal, wanted)[..., 0]
        change[:, 2:4] = np.clip(change[:, 2:4], -0.5, 0.5)
        parts[:, moving] += change.T
        parts[3] = np.clip(parts[3], 0.05, at[-1])
        moving = moving[abs(change[:, 2:4]).max(axis=1) > SETTLED_PX]
    model, jacobian = _step(at, parts)
    normal = jacobian @ np.swapaxes(jacobian, 1, 2) + 1e-9 * np.eye(6)
    residual, step, width = (profiles - model).std(axis=1), abs(2 * parts[1]), parts[3]
    # Samples are closer than pixels and share them.
    uncertainty = np.sqrt(np.linalg.inv(normal)[:, 3, 3]) * residual / STEP_PX**0.5
    is_step = (residual < MAX_RESIDUAL * step) & (uncertainty < MAX_UNCERTAINTY * width)
    is_step &= abs(parts[4:]).max(axis=0) * at[-1] < MAX_SLOPE * step
    is_step &= (abs(parts[2]) < MAX_OFFSET_PX) & (width > MIN_WIDTH_PX) & (width < at[-1] / 2.5)
    return width, is_step


def _step(at: Array, parts: Array) -> tuple[Array, Array]:
    """Return the profile (E, L) of parts (6, E), and its Jacobian (E, 6, L).

    The parts: mean, half the step, place, width, slope of the whole, slope of the outer parts.
    """
    mean, half, place, width, slope, bend = parts[:, :, None]
    z = (at - place) / width
    share = erf(z / np.sqrt(2))
    bell = np.sqrt(2 / np.pi) * np.exp(-z * z / 2) * half / width
    lines = np.broadcast_to(at, z.shape), np.broadcast_to(abs(at), z.shape)
    columns = np.ones_like(share), share, -bell, -bell * z, *lines
    return mean + half * share + slope * at + bend * abs(at), np.stack(columns, axis=1)
