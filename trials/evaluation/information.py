"""Fisher information of camera poses from observations of unknown points.

With independent Gaussian measurement errors the inverse of this information bounds the covariance
of every unbiased estimator (Cramér–Rao; Kay, Fundamentals of Statistical Signal Processing, 1993,
section 3.7).
"""

import numpy as np
from scipy import linalg, sparse

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.projection import point_jacobian
from vo.contract.rig import StereoRig


def pose_covariance(
    T_world_cam: Array, points_world: Array, camera: Indices, point: Indices, sigma: Array,
    rig: StereoRig,
) -> Array:  # fmt: skip
    """Return the Cramér–Rao bound of all poses given the first, with unknown points.

    Args:
        T_world_cam: (F, 4, 4) true poses.
        points_world: (J, 3) true points, metres.
        camera: (M,) index of the camera of each measurement.
        point: (M,) index of its point.
        sigma: (M, 3) standard deviations of u, v and disparity, pixels; infinite if not measured.
        rig: Stereo rig of all cameras.

    Returns:
        (6 F, 6 F), tangents (v m, w rad) in each camera's frame; zero for the first.

    Raises:
        LinAlgError: If the measurements do not determine all poses.
    """
    T_cam_world = se3.inverse(T_world_cam)[camera]
    R = T_cam_world[:, :3, :3]
    points_cam = np.einsum("mij,mj->mi", R, points_world[point]) + T_cam_world[:, :3, 3]
    by_camera_point = point_jacobian(points_cam, sigma, rig)  # whitened
    by_turn = by_camera_point @ se3.skew(points_cam)
    by_pose = np.concatenate([-by_camera_point, by_turn], axis=2)  # (M, 3, 6)
    by_point = by_camera_point @ R  # (M, 3, 3)
    frames, points = len(T_world_cam), len(points_world)
    own = np.zeros((frames, 6, 6))
    np.add.at(own, camera, by_pose.transpose(0, 2, 1) @ by_pose)
    of_points = np.zeros((points, 3, 3))
    np.add.at(of_points, point, by_point.transpose(0, 2, 1) @ by_point)
    point_covariance = np.linalg.inv(of_points)[point]
    mixed = by_pose.transpose(0, 2, 1) @ by_point  # (M, 6, 3)
    shape = (6 * frames, 3 * points)
    cross, weighted = (_blocks(x, camera, point, shape) for x in (mixed, mixed @ point_covariance))
    information = linalg.block_diag(*own) - (weighted @ cross.T).toarray()  # Schur complement
    covariance = np.zeros_like(information)
    factor = linalg.cho_factor(information[6:, 6:])
    covariance[6:, 6:] = linalg.cho_solve(factor, np.eye(6 * frames - 6))
    return covariance


def motion_covariance(covariance: Array, T_world_cam: Array, start: int, end: int) -> Array:
    """Return the covariance (6, 6) of a motion, tangent (v m, w rad) in the second camera.

    Args:
        covariance: (6 F, 6 F) as `pose_covariance` returns it.
        T_world_cam: (F, 4, 4) poses.
        start: Index of the first camera.
        end: Index of the second.
    """
    T_end_start = se3.inverse(T_world_cam[end]) @ T_world_cam[start]
    a, b = slice(6 * start, 6 * start + 6), slice(6 * end, 6 * end + 6)
    carried = se3.adjoint(T_end_start) @ covariance[a, b]
    own = se3.transform_covariance(T_end_start, covariance[a, a])
    return covariance[b, b] + own - carried - carried.T


def _blocks(
    values: Array, row: Indices, column: Indices, shape: tuple[int, int]
) -> sparse.csr_array:
    """Return the sparse matrix of (M, P, Q) blocks; blocks at the same position are added."""
    _, height, width = values.shape
    rows = (height * row)[:, None, None] + np.arange(height)[:, None]
    columns = (width * column)[:, None, None] + np.arange(width)
    places = (np.broadcast_to(x, values.shape).ravel() for x in (rows, columns))
    return sparse.coo_array((values.ravel(), tuple(places)), shape).tocsr()
