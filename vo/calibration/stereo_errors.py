"""Errors of a pair's calibration, from the rows in which both eyes see the same points.

In a rectified pair these rows are equal. Their differences over the image, over depth and over
motion show what is wrong: a pitch moves all rows, a roll those of one side up and of the other
down, a yaw those of the corners, a later exposure each row as the image moves. The length of the
baseline, the focal length of both cameras and the principal points along u change no row.

Quantities are taken in one after the other, as long as one is significant: what a second quantity
explains as well is then not taken twice.

Source: Hartley and Zisserman, Multiple View Geometry, 2004, 11.4 for the epipolar error; Draper and
Smith, Applied Regression Analysis, 1998, ch. 15 for the forward selection; Huber, 1967, for the
standard errors of clusters.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Indices, Table
from vo.contract.rig import StereoRig
from vo.stereo.right_camera import RightCamera, StereoErrors

STEPS = np.array([1e-4, 1e-4, 1e-4, 1e-3, 0.1, 1e-4, 1e-3, 1e-3])
"""Steps of numerical derivatives."""

PRIOR = np.array([0.1, 0.1, 0.1, 0.1, 5.0, 0.01, 0.003, 0.003])
"""Standard deviations of calibrations. At constant speed a delay looks like a camera in advance."""

PITCH = 0
LIKELY, UNLIKELY = (0, 1, 2, 3), (4, 5, 6, 7)
"""Quantities by what changes in use: mounts bend and clocks differ, lenses hardly change."""


@dataclass(frozen=True)
class SelectionLimits:
    """When a quantity is significant."""

    sigmas: float = 4.0
    """Standard errors."""
    effect_px: float = 0.1
    """Root mean square of the motion of the right image."""
    huber: float = 1.5
    """Residual, in standard deviations, at which the loss turns linear."""
    min_sigma_px: float = 0.02
    """Standard deviation of a row, to which no alignment is better."""
    iterations: int = 4
    """Linearizations."""
    converged_px: float = 0.005
    """Motion of the right image by the last step of a converged estimate."""


LIMITS = SelectionLimits()


@dataclass(frozen=True)
class StereoSamples(Table):
    """Points that both eyes see, row by row.

    Attributes:
        pixels: (N, 2) u, v in the left image.
        right_pixels: (N, 2) u, v in the right image, searched along u and v.
        velocity: (N, 6) of the left camera then, tangent (v m/s, w rad/s) in its frame.
        frame: (N,) number of the frame; errors of one frame may be alike.
    """

    pixels: Array
    right_pixels: Array
    velocity: Array
    frame: Indices


class Quantity(NamedTuple):
    """An estimated error of a calibration.

    Attributes:
        name: Attribute of `StereoErrors`.
        effect_px: Root mean square of the motion that it makes in the right image.
        significant: Whether it is beyond chance, and moves the image enough to be worth a thought.
    """

    name: str
    value: float
    standard_error: float
    effect_px: float
    significant: bool


@dataclass(frozen=True)
class StereoEstimate:
    """Estimated errors of a calibration.

    Attributes:
        errors: The significant ones; zero elsewhere.
        quantities: All that rows can show.
        row_px: Standard deviation of the differences of rows, robust, as they are and without the
            errors.
    """

    errors: StereoErrors
    quantities: tuple[Quantity, ...]
    row_px: tuple[float, float]

    @property
    def corrected(self) -> StereoErrors:
        """The errors that are corrected: rows do not tell whether a yaw or a lens is keystone."""
        return replace(self.errors, keystone_rad=0.0)


def estimate_errors(
    samples: StereoSamples, rig: StereoRig, effect_px: float = LIMITS.effect_px
) -> StereoEstimate:
    """Estimate the errors of a calibration from N samples; insignificant ones are zero.

    Those that are not zero move the right image by more than `effect_px`, root mean square.
    """
    nothing = np.zeros(len(STEPS))
    system = _System(samples, rig, nothing)
    before_px, chosen = system.sigma_px, _select(system, effect_px)
    for _ in range(LIMITS.iterations):
        theta = nothing.copy()
        theta[chosen] = system.solve(chosen)[0]
        change_px = np.abs(theta - system.theta) * system.unit_px
        if change_px.max() < LIMITS.converged_px:
            break
        system = _System(samples, rig, theta)
        chosen = _select(system, effect_px)
    quantities = tuple(_quantity(i, system, chosen) for i in range(len(STEPS)))
    return StereoEstimate(
        StereoErrors(*system.theta.tolist()), quantities, (before_px, system.sigma_px)
    )


def row_residuals(samples: StereoSamples, rig: StereoRig, errors: StereoErrors) -> Array:
    """Row (N,) in the right image, less that in which the left pixel must lie, px."""
    right = RightCamera(errors, rig, samples.velocity)
    disparity_px = right.disparity(samples.pixels, samples.right_pixels[:, 0])
    return samples.right_pixels[:, 1] - right.see(samples.pixels, disparity_px)[:, 1]


class _System:
    """Normal equations of the rows' residuals, linearized about some errors (8,).

    Attributes:
        theta: (8,) the errors.
        sigma_px: Robust standard deviation of the residuals.
        unit_px: (8,) root mean square of the motion of the right image by a unit of each error.
    """

    def __init__(self, samples: StereoSamples, rig: StereoRig, theta: Array) -> None:
        right = RightCamera(StereoErrors(*theta), rig, samples.velocity)
        disparity_px = right.disparity(samples.pixels, samples.right_pixels[:, 0])
        seen = right.see(samples.pixels, disparity_px)
        residual = samples.right_pixels[:, 1] - seen[:, 1]
        J, units = np.empty((len(residual), len(STEPS))), np.empty(len(STEPS))
        for i, step in enumerate(np.diag(STEPS)):
            moved = replace(right, errors=StereoErrors(*(theta + step)))
            shift = (moved.see(samples.pixels, disparity_px) - seen) / STEPS[i]
            units[i] = np.sqrt(np.mean(np.sum(shift**2, axis=1))) if len(shift) else 0.0
            rows = row_residuals(samples, rig, moved.errors)
            J[:, i] = (residual - rows) / STEPS[i]
        self.theta, self.sigma_px, self.unit_px = theta, _robust_sigma(residual), units
        ratio = np.abs(residual) / self.sigma_px
        weight = np.minimum(1, LIMITS.huber / np.maximum(ratio, 1e-9)) / self.sigma_px**2
        frames = np.unique(samples.frame, return_inverse=True)[1]
        weighted, n = weight[:, None] * J, int(frames.max(initial=-1)) + 1
        of_frame = [frames == k for k in range(n)]
        self._gradient = np.array([residual[x] @ weighted[x] for x in of_frame]).reshape(n, -1)
        self._information = np.array([J[x].T @ weighted[x] for x in of_frame])
        self._information = self._information.reshape(n, len(STEPS), len(STEPS))
        self._allow_shake()

    def _allow_shake(self) -> None:
        """Let each frame have a pitch of its own, as much as the frames show.

        Velocities are means of steps; what shakes between two frames is not in them.
        """
        own = np.maximum(self._information[:, PITCH, PITCH], 1e-9)
        variance = np.var(self._gradient[:, PITCH] / own) - np.mean(1 / own)
        if len(own) < 3 or not variance > 0:
            return
        column = self._information[:, PITCH] / np.sqrt(own + 1 / variance)[:, None]
        row = self._gradient[:, PITCH] / np.sqrt(own + 1 / variance)
        self._gradient = self._gradient - column * row[:, None]
        self._information = self._information - column[:, :, None] * column[:, None, :]

    def solve(self, rows: list[int]) -> tuple[Array, Array]:
        """Values (K,) and standard errors (K,) of K quantities, of which the others are zero.

        Of the covariance by the residuals' size and that by the scatter of frames, the larger one
        counts.
        """
        information = self._information.sum(axis=0)
        gradient = self._gradient.sum(axis=0) + information @ self.theta
        covariance = np.linalg.inv((information + np.diag(PRIOR**-2))[np.ix_(rows, rows)])
        values = covariance @ gradient[rows]
        variance, frames = np.diag(covariance), len(self._gradient)
        if frames > 2 * len(rows):
            change = -self.theta
            change[rows] += values
            scores = (self._gradient - self._information @ change)[:, rows]
            scatter = covariance @ (scores.T @ scores) @ covariance
            variance = np.maximum(variance, frames / (frames - len(rows)) * np.diag(scatter))
        return values, np.sqrt(variance)


def _select(system: _System, effect_px: float) -> list[int]:
    """Take in quantities, the most significant one first, until no other is; likely ones first."""
    chosen: list[int] = []
    for group in LIKELY, UNLIKELY:
        while rest := [i for i in group if i not in chosen]:
            found = [_quantity(i, system, chosen) for i in rest]
            ratios = [abs(x.value) / x.standard_error for x in found]
            best = int(np.argmax(ratios))
            if ratios[best] < LIMITS.sigmas or found[best].effect_px < effect_px:
                break
            chosen.append(rest[best])
    return chosen


def _quantity(i: int, system: _System, chosen: list[int]) -> Quantity:
    """Estimate a quantity together with the chosen ones."""
    rows = chosen if i in chosen else [*chosen, i]
    values, errors = system.solve(rows)
    value, error = float(values[rows.index(i)]), float(errors[rows.index(i)])
    effect_px = abs(value) * float(system.unit_px[i])
    return Quantity(StereoErrors.names()[i], value, error, effect_px, i in chosen)


def _robust_sigma(residual: Array) -> float:
    """Standard deviation of residuals (N,) about zero, by their median size."""
    known = np.abs(residual[np.isfinite(residual)])
    return max(1.4826 * float(np.median(known)), LIMITS.min_sigma_px) if len(known) else np.inf
