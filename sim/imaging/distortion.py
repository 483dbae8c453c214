"""Distortion of lenses: rays to normalised points of the image and back, and folds of the model.

Points (..., 2) are pixels less the principal point, over the focal length of the raw image.

Source: OpenCV, camera calibration and 3D reconstruction: k1, k2, p1, p2, k3, k4, k5, k6; fisheye
camera model, after Kannala and Brandt, A generic camera model, 2006.
"""

import math

import numpy as np
from numpy.polynomial import Polynomial

from sim.camera_settings import SensorSettings
from vo.contract.arrays import Array, Mask

NEWTON_STEPS = 30
CONVERGED = 1e-10
ANGLE_MAX_RAD = math.radians(95) + 1e-9
"""Largest angle from the axis at which an equidistant lens has light, 95 degrees."""


def has_distortion(settings: SensorSettings) -> bool:
    """Whether the lens distorts."""
    return is_equidistant(settings) or any(coefficients(settings))


def is_equidistant(settings: SensorSettings) -> bool:
    """Whether the lens is a fisheye."""
    return settings.lens == "equidistant"


def coefficients(settings: SensorSettings) -> list[float]:
    """Return the coefficients as OpenCV lists them: 4, 5 or 8, and 4 of an equidistant lens."""
    if is_equidistant(settings):
        return [settings.k1, settings.k2, settings.k3, settings.k4]
    more = [settings.k3, settings.k4, settings.k5, settings.k6]
    count = 4 if any(more[1:]) else 1 if settings.k3 else 0
    return [settings.k1, settings.k2, settings.p1, settings.p2, *more[:count]]


def project(settings: SensorSettings, rays: Array) -> Array:
    """Map rays (..., 3) in camera axes, of any length, to points; NaN where a lens has no light."""
    x, y, z = np.moveaxis(rays, -1, 0)
    with np.errstate(all="ignore"):
        if not is_equidistant(settings):
            flat = rays[..., :2] / np.where(z > 0, z, np.nan)[..., None]
            return np.where(
                _inside_fold(settings, flat)[..., None], distort(settings, flat), np.nan
            )
        radius = np.hypot(x, y)
        angle = np.arctan2(radius, z)
        angle = np.where(angle <= ANGLE_MAX_RAD, angle, np.nan)
        scale = np.where(radius > 0, _equidistant(settings)(angle) / radius, 1 / np.abs(z))
    return rays[..., :2] * np.where(np.isnan(angle), np.nan, scale)[..., None]


def rays_of(settings: SensorSettings, points: Array) -> Array:
    """Invert `project`: rays (..., 3), of z = 1 or, of an equidistant lens, of length 1.

    NaN where no ray arrives, or only one from beyond a fold of the distortion.
    """
    if not is_equidistant(settings):
        flat = undistort(settings, points)
        return np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
    radius = np.linalg.norm(points, axis=-1)
    theta = _equidistant(settings)
    angle = np.minimum(radius, ANGLE_MAX_RAD)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            angle = np.clip(angle - (theta(angle) - radius) / theta.deriv()(angle), 0, math.pi)
        arrived = (np.abs(theta(angle) - radius) < CONVERGED) & (angle <= ANGLE_MAX_RAD)
        scale = np.where(radius > 0, np.sin(angle) / radius, 1)
    rays = np.concatenate([points * scale[..., None], np.cos(angle)[..., None]], axis=-1)
    return np.where(arrived[..., None], rays, np.nan)


def image_radius(settings: SensorSettings, angle_rad: float) -> float:
    """Return the radius in an equidistant image at an angle from the axis."""
    return float(_equidistant(settings)(angle_rad))


def fold_angle_rad(settings: SensorSettings) -> float:
    """Return the angle at which the radius in an equidistant image turns back, or infinity."""
    return _first_root(_equidistant(settings).deriv())


def fold_radius(settings: SensorSettings) -> float:
    """Return the radius in the image beyond which the radial distortion turns back, or infinity."""
    if is_equidistant(settings):
        angle = fold_angle_rad(settings)
        return image_radius(settings, angle) if angle <= ANGLE_MAX_RAD else math.inf
    radius = math.sqrt(_first_root(_radial_slope(settings)))
    if math.isinf(radius):
        return radius
    above, below = _radial(settings)
    return float(radius * above(radius**2) / below(radius**2))


def distort(settings: SensorSettings, points: Array) -> Array:
    """Distort normalised (..., 2) points x/z, y/z by a radial-tangential lens."""
    x, y = points[..., 0], points[..., 1]
    r2 = x * x + y * y
    radial, _ = _radial_factor(settings, r2)
    u = x * radial + 2 * settings.p1 * x * y + settings.p2 * (r2 + 2 * x * x)
    v = y * radial + settings.p1 * (r2 + 2 * y * y) + 2 * settings.p2 * x * y
    return np.stack([u, v], axis=-1)


def undistort(settings: SensorSettings, distorted: Array) -> Array:
    """Invert `distort` for (..., 2) points by Newton's method.

    NaN where no ray arrives, or only one from beyond a fold of the distortion.
    """
    points = np.array(distorted, dtype=np.float64)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            error = distort(settings, points) - distorted
            (a, b), (c, d) = _jacobian(settings, points)
            determinant = a * d - b * c
            points[..., 0] -= (d * error[..., 0] - b * error[..., 1]) / determinant
            points[..., 1] -= (a * error[..., 1] - c * error[..., 0]) / determinant
            if np.abs(error).max(initial=0.0) < CONVERGED:
                break
        arrived = np.abs(distort(settings, points) - distorted).max(axis=-1) < 10 * CONVERGED
        arrived &= _inside_fold(settings, points)
    return np.where(arrived[..., None], points, np.nan)


def is_inside_fold(settings: SensorSettings, rays: Array) -> Mask:
    """Whether each ray (..., 3) arrives, and inside the first fold of the distortion."""
    points = project(settings, rays)
    inside = np.linalg.norm(points, axis=-1) < fold_radius(settings)
    return inside if is_equidistant(settings) else ~np.isnan(points[..., 0])


def _equidistant(settings: SensorSettings) -> Polynomial:
    """Radius over the angle from the axis: θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)."""
    k1, k2, k3, k4 = coefficients(settings)
    return Polynomial([0, 1, 0, k1, 0, k2, 0, k3, 0, k4])


def _radial_factor(settings: SensorSettings, r2: Array) -> tuple[Array, Array]:
    """Return the radial factor at squared radii, and its derivative by them."""
    k1, k2, k3 = settings.k1, settings.k2, settings.k3
    above, slope = 1 + k1 * r2 + k2 * r2 * r2, k1 + 2 * k2 * r2
    if k3:
        above, slope = above + k3 * r2**3, slope + 3 * k3 * r2 * r2
    k4, k5, k6 = settings.k4, settings.k5, settings.k6
    if not any((k4, k5, k6)):
        return above, slope
    below, slope_below = 1 + k4 * r2 + k5 * r2 * r2 + k6 * r2**3, k4 + 2 * k5 * r2 + 3 * k6 * r2**2
    return above / below, (slope * below - above * slope_below) / below**2


def _jacobian(settings: SensorSettings, points: Array) -> Array:
    """Return the (2, 2, ...) derivative of `distort`."""
    x, y = points[..., 0], points[..., 1]
    p1, p2 = settings.p1, settings.p2
    radial, slope = _radial_factor(settings, x * x + y * y)
    slope = 2 * slope
    across = slope * x * y + 2 * p1 * x + 2 * p2 * y
    along_x = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    along_y = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    return np.array([[along_x, across], [across, along_y]])


def _radial(settings: SensorSettings) -> tuple[Polynomial, Polynomial]:
    """Numerator and denominator of the radial factor, in the squared radius."""
    above = Polynomial([1, settings.k1, settings.k2, settings.k3])
    return above, Polynomial([1, settings.k4, settings.k5, settings.k6])


def _radial_slope(settings: SensorSettings) -> Polynomial:
    """Return what is positive while radius times radial factor increases, and 0 at its poles."""
    above, below = _radial(settings)
    s = Polynomial([0, 1])
    rises = (above + 2 * s * above.deriv()) * below - 2 * s * above * below.deriv()
    return rises * below


def _first_root(polynomial: Polynomial) -> float:
    """Return the smallest positive real root, or infinity."""
    roots = np.asarray(polynomial.trim().roots(), complex)
    real = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)]
    return float(real.min(initial=math.inf))


def _inside_fold(settings: SensorSettings, points: Array) -> Mask:
    """Whether each undistorted point (..., 2) lies inside the first fold, all the way out to it."""
    r2 = (points**2).sum(axis=-1)
    (a, b), (c, d) = _jacobian(settings, points)
    return (r2 < _first_root(_radial_slope(settings))) & (a * d - b * c > 0)
