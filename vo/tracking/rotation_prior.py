"""Rotation between two whole images, where the prediction by constant velocity fails.

A hand-held camera turns by more from frame to frame than a search window covers, and turns back
before the next. Nearly all image motion of such a step is rotation, which very small images show.

Source: Klein and Murray, Improving the Agility of Keyframe-Based SLAM, ECCV 2008 (small blurry
images); Baker and Matthews, Lucas–Kanade 20 Years On, IJCV 2004 (inverse compositional form).
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.projection import image_jacobian
from vo.contract.rig import StereoRig

WIDTHS_PX = (20, 40)
"""Of the small images, coarse to fine: a rotation is a few pixels of the first."""

MAX_STEPS = 8
"""Gauss-Newton iterations with each image size."""

CONVERGED_PX = 0.1
"""Step, in pixels of the small image, that ends the iterations."""

MIN_CONTRAST = 1e-3
"""Standard deviation, grey levels, of a blank image."""


def align_rotation(before: Image, now: Image, rig: StereoRig, expected: Array) -> Array:
    """Estimate R_before_now (3, 3) between two images (H, W), as if all points were far away.

    The expected rotation (3, 3) is tried as a start, beside none.
    """
    guesses = [np.eye(3), expected.T]
    for width in WIDTHS_PX:
        old, new = _Small.of(before, width, rig), _Small.of(now, width, rig)
        found = [old.align(new, R_now_before) for R_now_before in guesses]
        guesses = [max(found, key=lambda x: x[0])[1]]
    return guesses[0].T


@dataclass(frozen=True)
class _Small:
    """An image (h, w) of few pixels, with its focal length and principal point (2,) in these."""

    grey: Array
    f_px: float
    centre: Array

    @staticmethod
    def of(image: Image, width: int, rig: StereoRig) -> "_Small":
        scale = width / image.shape[1]
        size = width, max(2, round(scale * image.shape[0]))
        grey = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        centre = (np.array([rig.cx_px, rig.cy_px]) + 0.5) * scale - 0.5
        return _Small(cv2.GaussianBlur(grey, (0, 0), 1.0), scale * rig.f_px, centre)

    @cached_property
    def rays(self) -> Array:
        """(h w, 3) directions of the pixels."""
        height, width = self.grey.shape
        v, u = np.mgrid[:height, :width]
        xy = (np.stack([u.ravel(), v.ravel()], axis=1) - self.centre) / self.f_px
        return np.column_stack([xy, np.ones(len(xy))])

    @cached_property
    def jacobian(self) -> Array:
        """(h w, 3) derivatives of the standardised image by a rotation of its rays."""
        down, across = np.gradient(self.grey / max(float(self.grey.std()), MIN_CONTRAST))
        # Rays turn against the camera.
        du, dv = (-np.column_stack(row[:3]) for row in image_jacobian(*self.rays.T))
        return self.f_px * (across.reshape(-1, 1) * du + down.reshape(-1, 1) * dv)

    def align(self, new: "_Small", R_new_old: Array) -> tuple[float, Array]:
        """Align the new image with this one by rotation; return correlation and rotation."""
        zncc, solve = 0.0, np.linalg.pinv(self.jacobian)
        for _ in range(MAX_STEPS):
            x, y, z = R_new_old @ self.rays.T
            ahead = np.where(z > 0, z, np.nan)
            pixels = new.f_px * np.stack([x, y]) / ahead + new.centre[:, None]
            u, v = pixels.astype(np.float32).reshape(2, *self.grey.shape)
            seen = cv2.remap(new.grey, u, v, cv2.INTER_LINEAR, borderValue=np.nan).ravel()
            both = np.isfinite(seen)
            old, now = _standardised(self.grey.ravel(), both), _standardised(seen, both)
            zncc = float(old @ now) / max(int(both.sum()), 1)
            back = solve @ (old - now)
            R_new_old = R_new_old @ se3.exp(np.concatenate([np.zeros(3), back]))[:3, :3]
            if self.f_px * np.abs(back).max() < CONVERGED_PX:
                break
        return zncc, R_new_old


def _standardised(grey: Array, inside: Array) -> Array:
    """Mean 0 and deviation 1 of the pixels inside; 0 outside."""
    some = grey[inside]
    if not len(some):
        return np.zeros(len(grey))
    level = (grey - some.mean()) / max(float(some.std()), MIN_CONTRAST)
    return np.where(inside, level, 0.0)
