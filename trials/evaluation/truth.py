"""Ground truth of image points from the labels of a dataset: depth, position, later projections."""

from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from sim.labels.formats import label_file
from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DatasetError
from vo.contract.rig import StereoRig
from vo.contract.trajectory import Trajectory
from vo.recordings.euroc import read_euroc_truth
from vo.recordings.images import read_float
from vo.recordings.readers import read_truth

SAME_SURFACE = 0.02
"""Largest relative difference of disparities of one surface."""

SAME_SURFACE_PX = 0.1
"""Absolute difference of disparities of one surface that is allowed in addition, px."""

EDGE_PX = 1.0
"""Difference of disparities of neighbouring pixels, px, above which they are of two surfaces."""


def true_trajectory(dataset: Path) -> Trajectory:
    """Read the true T_world_cam, or the truth of positions where a recording has no more.

    Raises:
        DatasetError: If the dataset is unreadable or has none.
    """
    truth = read_truth(dataset)
    if truth is None:
        raise DatasetError(f"{dataset}: has no ground truth")
    return truth


def true_rig(dataset: Path, manifest: Mapping[str, Any]) -> StereoRig:
    """Return the camera as it is, to which labels belong; its calibration may differ.

    Raises:
        DatasetError: If the manifest lacks it.
    """
    try:
        true = manifest["rig_true"]
        names = [field.name for field in fields(StereoRig) if field.name in true]
        values: dict[str, Any] = {name: true[name] for name in names}
        values["T_body_cam"] = np.array(values["T_body_cam"])
        return StereoRig(**values)
    except (KeyError, TypeError):
        message = f"{dataset / MANIFEST}: the true rig is missing or malformed"
        raise DatasetError(message) from None


class TrueWorld:
    """Labels of a dataset of static points, read on demand.

    Attributes:
        rig: True rig, which may differ from its calibration.
    """

    def __init__(self, dataset: Path) -> None:
        """Open a dataset; DatasetError if it has no depth labels, poses or manifest."""
        manifest = read_manifest(dataset)
        self.rig = true_rig(dataset, manifest)
        if not label_file(dataset, "depth", 0).parent.is_dir():
            message = f"{dataset}: has no depth labels; generate it with labels.depth=true"
            raise DatasetError(message)
        truth = read_euroc_truth(dataset, self.rig.T_body_cam)
        if truth is None or truth.point_cam is not None:
            raise DatasetError(f"{dataset}: has no true poses")
        self._trajectory, self._dataset = truth, dataset
        self._disparity = lru_cache(4)(self._read_disparity)

    def T_world_cam(self, time_ns: int) -> Array:
        """Return the pose (4, 4) of the left camera."""
        return self._trajectory.at(np.array([time_ns])).T_ref_frame[0]

    def disparity(self, time_ns: int, pixels: Array) -> Array:
        """Return the disparity (N,) at (N, 2) left-image pixels; NaN where there is no surface.

        Disparity is linear in the pixel on a plane, so it is interpolated, except across edges.
        """
        label = self._disparity(time_ns)
        corners, weights = _corners(label, pixels)
        nearest = corners[np.arange(len(pixels)), np.argmax(weights, axis=1)]
        with np.errstate(invalid="ignore"):
            edge = ~(np.ptp(corners, axis=1) <= EDGE_PX)
        inside = _inside(label, pixels)
        return np.where(inside, np.where(edge, nearest, (corners * weights).sum(axis=1)), np.nan)

    def points_world(self, time_ns: int, pixels: Array) -> Array:
        """Return surface points (N, 3) at (N, 2) left-image pixels, metres; NaN for none."""
        points_cam = self.rig.triangulate(pixels, self.disparity(time_ns, pixels))
        return se3.transform(self.T_world_cam(time_ns), points_cam)

    def project(self, time_ns: int, points_world: Array) -> Array:
        """Return left-image pixels (N, 2) of (N, 3) points, visible or not."""
        return self._projected(time_ns, points_world)[:, :2]

    def project_visible(self, time_ns: int, points_world: Array) -> Array:
        """Return left-image pixels (N, 2) of (N, 3) static points; NaN for invisible points.

        A point is visible if the depth label at its projection, or beside it, has its depth.
        """
        expected = self._projected(time_ns, points_world)
        label = self._disparity(time_ns)
        d = expected[:, 2]
        corners, _ = _corners(label, expected[:, :2])
        here = np.column_stack([self.disparity(time_ns, expected[:, :2]), corners])
        with np.errstate(invalid="ignore"):
            off = np.abs(here - d[:, None])
            seen = (off <= SAME_SURFACE * d[:, None] + SAME_SURFACE_PX).any(axis=1)
        seen &= _inside(label, expected[:, :2])
        return np.where(seen[:, None], expected[:, :2], np.nan)

    def _projected(self, time_ns: int, points_world: Array) -> Array:
        T_cam_world = se3.inverse(self.T_world_cam(time_ns))
        return self.rig.project(se3.transform(T_cam_world, points_world))

    def _read_disparity(self, time_ns: int) -> Array:
        depth_m = read_float(label_file(self._dataset, "depth", time_ns))
        return self.rig.f_px * self.rig.baseline_m / depth_m.astype(np.float64)


def _inside(label: Array, pixels: Array) -> Mask:
    height, width = label.shape
    with np.errstate(invalid="ignore"):
        inside: Mask = (pixels >= 0) & (pixels <= [width - 1, height - 1])
    return np.all(inside, axis=1)


def _corners(label: Array, pixels: Array) -> tuple[Array, Array]:
    """Return values and bilinear weights (N, 4) of the four pixels around each position."""
    height, width = label.shape
    places = np.nan_to_num(pixels).clip(0, [width - 1, height - 1])
    u, v = np.minimum(places, [width - 2, height - 2]).astype(np.int64).T
    a, b = places[:, 0] - u, places[:, 1] - v
    values = np.stack([label[v, u], label[v, u + 1], label[v + 1, u], label[v + 1, u + 1]], -1)
    weights = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], axis=-1)
    return values, weights
