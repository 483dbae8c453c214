"""The raw image of a lens as rays: what it takes to render a wide one, and to label any.

A lens of up to 190 degrees is rendered as up to five pinhole views, the faces of a cube around each
camera, which are stacked into one tall image and resampled.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from sim.imaging import lens
from sim.imaging.distortion import is_equidistant
from sim.imaging.linear_light import decode
from sim.imaging.resample import TAPS_PX, sample
from sim.settings import RecordSettings
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig

TURNS_DEG = ((0, 0), (-90, 0), (90, 0), (0, 90), (0, -90))
"""Yaw to the right and pitch upwards of the faces of a cube: ahead, left, right, up, down."""


@dataclass(frozen=True)
class Grid:
    """Raw pixels (H, W) of the left camera: unit rays (H, W, 3) and places in what is rendered.

    u_px, v_px and `per_depth`, the distance along the ray over planar depth there, are (H, W)
    float32; all is NaN where the lens has no light.
    """

    rays: Array
    u_px: Array
    v_px: Array
    per_depth: Array


@dataclass(frozen=True)
class Views:
    """Square pinhole views of one size: rotations (V, 3, 3) from their axes to the camera's."""

    rig: StereoRig
    R_cam_views: Array

    def places(self, rays: Array) -> tuple[Array, Array, Array]:
        """Return u_px, v_px in the stack of views and 1 / z of unit rays (H, W, 3), float32."""
        R, size = self.R_cam_views, self.rig.height_px
        facing = np.nan_to_num(rays) @ R[:, :, 2].T
        best = facing.argmax(axis=-1)
        x, y, z = np.moveaxis(np.einsum("...ij,...i->...j", R[best], rays), -1, 0)
        u = self.rig.f_px * x / z + self.rig.cx_px
        v = self.rig.f_px * y / z + self.rig.cy_px + size * best
        return u.astype(np.float32), v.astype(np.float32), (1 / z).astype(np.float32)


@dataclass(frozen=True)
class RawLens:
    """Lens of a pair: the rig, true and with the margin that is rendered, and all settings."""

    settings: RecordSettings
    rig: StereoRig
    rendered: StereoRig

    @cached_property
    def views(self) -> Views | None:
        """What is rendered of an equidistant lens; None for others, which need one pinhole.

        Neighbours overlap by what resampling needs; the scale is that in the middle of the lens.
        """
        if not is_equidistant(self.settings.sensor):
            return None
        f_px = math.ceil(lens.raw_focal_px(self.settings.sensor, self.rig))
        size, turns = 2 * (f_px + TAPS_PX + 1), np.array(TURNS_DEG)
        R = Rotation.from_euler("YX", turns, degrees=True).as_matrix()
        middle = (size - 1) / 2
        rig = StereoRig(size, size, f_px, middle, middle, self.rig.baseline_m)
        every = Views(rig, R)
        seen = np.unique(every.places(self._rays(0))[1] // size)
        return Views(rig, R[seen[np.isfinite(seen)].astype(int)])

    def raw_light(self, camera: int, stack: Image) -> Array:
        """Resample the stacked views (V N, N[, 3]) of a camera to linear light with the margin.

        (H', W'[, 3]) float32 in the rendered size, 0 where the lens has no light.
        """
        return np.nan_to_num(sample(decode(stack), *self._light_places[camera]))

    @cached_property
    def grid(self) -> Grid:
        """The pixels of the left raw image in the rendered pinhole, or in the stacked views."""
        rays = lens.raw_rays(self.settings.sensor, self.rig, lens.pixel_grid(self.rig))
        if self.views:
            return Grid(rays, *self.views.places(rays))
        u, v, _ = np.moveaxis(self.rendered.project(rays).astype(np.float32), -1, 0)
        return Grid(rays, u, v, (1 / rays[..., 2]).astype(np.float32))

    def range_m(self, camera: int, depth_m: Array) -> Array:
        """Return the distance along the ray (H', W') of each pixel of the light that is rendered.

        The planar depth is that of a camera in the rendered pinhole, or in the stacked views.
        """
        if self.views is None:
            return depth_m * self._per_depth
        u, v, per_depth = self.views.places(self._rays(camera))
        lit = np.isfinite(u)
        found = np.full(u.shape, np.nan, np.float32)
        v_px, u_px = (np.rint(x[lit]).astype(int) for x in (v, u))
        found[lit] = depth_m[v_px, u_px] * per_depth[lit]
        return found

    @cached_property
    def _per_depth(self) -> Array:
        """(H', W') distance along the ray over planar depth, in the rendered pinhole."""
        flat = self.rendered.normalized(lens.pixel_grid(self.rendered))
        return np.sqrt(1 + (flat**2).sum(axis=-1)).astype(np.float32)

    @cached_property
    def _light_places(self) -> list[tuple[Array, Array]]:
        assert self.views is not None
        return [self.views.places(self._rays(camera))[:2] for camera in (0, 1)]

    def _rays(self, camera: int) -> Array:
        """Rays of a camera's raw pixels with their margin, in the axes of its nominal pinhole."""
        pad_px = (self.rendered.width_px - self.rig.width_px) // 2
        grid = lens.pixel_grid(self.rig, pad_px)
        rays = lens.raw_rays(self.settings.sensor, self.rig, grid)
        return rays @ lens.miscalibration_rotation(self.settings.calibration).T if camera else rays
