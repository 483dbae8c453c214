"""Landmarks, keyframes, and the window of keyframes in which landmarks are tracked."""

from dataclasses import dataclass, replace

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices, Mask, Table
from vo.contract.observations import Observations


@dataclass(frozen=True)
class TrackedFrame:
    """A left image and the observations that agree with its pose, landmark ids ascending."""

    left: Image
    observations: Observations


@dataclass(frozen=True)
class Keyframe(TrackedFrame):
    """A frame whose image and observations are kept, its number in the run and its pose (4, 4).

    The covariance (6, 6) of T_odom_cam is of the tangent (v m, w rad) in the camera's frame. The
    image moved along a path (2,), px, during the exposure; None if by too little to be looked for.
    """

    serial: int
    T_odom_cam: Array
    covariance: Array
    path_px: Array | None = None


@dataclass(frozen=True)
class Landmarks(Table):
    """Points of the map, row by row.

    Attributes:
        ids: (N,) ascending, unique over the whole run.
        points_odom: (N, 3) metres.
        spread_odom: (N, 3) standard deviation of the point along the ray that saw it first.
        descriptors: (N, P) latest descriptor, for matching.
        views: (N,) frames that observed the landmark, keyframes or not.
        anchor: (N,) serial of the keyframe that holds the template for alignment.
        anchor_pixels: (N, 2) template centre in that keyframe.
        anchor_depth_m: (N,) depth there.
        anchor_slopes: (N, 2) slant of the surface there: change of disparity per pixel along u, v.
    """

    ids: Indices
    points_odom: Array
    spread_odom: Array
    descriptors: Array
    views: Indices
    anchor: Indices
    anchor_pixels: Array
    anchor_depth_m: Array
    anchor_slopes: Array

    def update(self, rows: Indices | Mask, **columns: Array) -> "Landmarks":
        """Replace the named columns of some rows."""
        renewed = {name: getattr(self, name).copy() for name in columns}
        for name, values in columns.items():
            renewed[name][rows] = values
        return replace(self, **renewed)


@dataclass(frozen=True)
class LocalMap:
    """The last keyframes and the landmarks that they observe.

    Attributes:
        keyframes: Oldest first.
        landmarks: Those whose anchor is among the keyframes.
        noise: Factors on the assumed standard deviations of pixels and of disparities, learnt
            from residuals.
        first_serial: Of the first keyframe of the segment, in the window or not.
    """

    keyframes: tuple[Keyframe, ...]
    landmarks: Landmarks
    next_serial: int
    next_id: int
    noise: tuple[float, float] = (1.0, 1.0)
    first_serial: int = 0

    def grey(self) -> Image:
        """Grey level of each landmark at its template's centre: (N,) uint8."""
        grey = np.zeros(len(self.landmarks), np.uint8)
        for keyframe in self.keyframes:
            anchored = self.landmarks.anchor == keyframe.serial
            u, v = np.rint(self.landmarks.anchor_pixels[anchored]).astype(np.int64).T
            grey[anchored] = keyframe.left[v, u]
        return grey


def empty_map(
    next_serial: int = 0, next_id: int = 0, noise: tuple[float, float] = (1.0, 1.0)
) -> LocalMap:
    """Make a map without keyframes or landmarks, which continues the numbers of another one."""
    none = np.zeros(0, dtype=np.int64)
    landmarks = Landmarks(
        ids=none,
        points_odom=np.zeros((0, 3)),
        spread_odom=np.zeros((0, 3)),
        descriptors=np.zeros((0, 0), np.float32),
        views=none,
        anchor=none,
        anchor_pixels=np.zeros((0, 2)),
        anchor_depth_m=np.zeros(0),
        anchor_slopes=np.zeros((0, 2)),
    )
    return LocalMap((), landmarks, next_serial, next_id, noise=noise, first_serial=next_serial)


def renewed_map(local_map: LocalMap) -> LocalMap:
    """Make an empty map that continues the numbers and the learnt noise of another one."""
    return empty_map(local_map.next_serial, local_map.next_id, local_map.noise)


def pose_covariance(keyframe: Keyframe, T_odom_cam: Array, relative: Array) -> Array:
    """Covariance (6, 6) of a pose: a keyframe's at that pose, plus the relative one."""
    T_cam_keyframe = se3.inverse(T_odom_cam) @ keyframe.T_odom_cam
    return se3.transform_covariance(T_cam_keyframe, keyframe.covariance) + relative


def transform_map(local_map: LocalMap, T_new_old: Array, covariance: Array) -> LocalMap:
    """Transform all poses and points by a rigid motion (4, 4) of the odometry frame.

    The last keyframe's covariance (6, 6) is given; the others' follow from it.
    """
    last = T_new_old @ local_map.keyframes[-1].T_odom_cam

    def transformed(k: Keyframe) -> Keyframe:
        T = T_new_old @ k.T_odom_cam
        moved = se3.transform_covariance(se3.inverse(T) @ last, covariance)
        return replace(k, T_odom_cam=T, covariance=moved)

    keyframes = tuple(map(transformed, local_map.keyframes))
    points = se3.transform(T_new_old, local_map.landmarks.points_odom)
    spread = local_map.landmarks.spread_odom @ T_new_old[:3, :3].T
    landmarks = replace(local_map.landmarks, points_odom=points, spread_odom=spread)
    return replace(local_map, keyframes=keyframes, landmarks=landmarks)
