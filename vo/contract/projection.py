"""How a rectified stereo pair sees a point, and how that changes with the point and the camera.

Tangents move the camera in its own frame; compiled code orders them (w, v), as GTSAM's Pose3 does.
"""

from typing import Any

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.contract.rig import StereoRig

MIN_DEPTH_M = 1e-3
"""Smallest depth of a point in a compiled projection, while a pose is tried."""

Row = tuple[Any, Any, Any, Any, Any, Any]
"""Six numbers, or six arrays (N,): derivatives by the tangent (w, v)."""


def image_jacobian(x: Any, y: Any, inverse_z: Any) -> tuple[Row, Row]:
    """Differentiate normalised image coordinates by the camera's tangent (w, v), rad and m.

    Of a point in the camera frame, x is x / z, y is y / z and inverse_z is 1 / z: numbers, also in
    compiled code, or arrays (N,). The derivatives of x come first, then those of y.

    Source: Longuet-Higgins and Prazdny, The interpretation of a moving retinal image, 1980.
    """
    return (
        (x * y, -1 - x * x, y, -inverse_z, 0.0, x * inverse_z),
        (1 + y * y, -x * y, -x, 0.0, -inverse_z, y * inverse_z),
    )


def project_points(points_odom: Array, T_odom_cam: Array, rig: StereoRig) -> Array:
    """Project (N, 3) points, metres, to (N, 3) left-image u, v and disparity of a camera (4, 4).

    NaN behind the camera, as `StereoRig.project`, in one compiled loop.
    """
    f = np.array([rig.f_px, rig.f_px, rig.cx_px, rig.cy_px, rig.f_px * rig.baseline_m])
    return _project_all(points_odom, T_odom_cam, f)


@compiled()
def _project_all(points: Array, T: Array, intrinsics: Array) -> Array:
    fx, fy, cx, cy, fb = intrinsics
    found = np.empty((len(points), 3))
    for i in range(len(points)):
        dx, dy, dz = points[i, 0] - T[0, 3], points[i, 1] - T[1, 3], points[i, 2] - T[2, 3]
        x = T[0, 0] * dx + T[1, 0] * dy + T[2, 0] * dz
        y = T[0, 1] * dx + T[1, 1] * dy + T[2, 1] * dz
        z = T[0, 2] * dx + T[1, 2] * dy + T[2, 2] * dz
        inverse_z = 1 / z if z > 0 else np.nan
        found[i, 0], found[i, 1] = fx * x * inverse_z + cx, fy * y * inverse_z + cy
        found[i, 2] = fb * inverse_z
    return found


def stereo_jacobian(points_cam: Array, rig: StereoRig) -> Array:
    """Differentiate u, v and disparity of points (N, 3) by the camera's tangent (v, w): (N, 3, 6).

    The points are in the camera frame, metres.
    """
    (x, y), inverse_z = (points_cam[:, :2] / points_cam[:, 2:]).T, 1 / points_cam[:, 2]
    disparity = rig.baseline_m * inverse_z
    of_disparity = (disparity * y, -disparity * x, 0.0, 0.0, 0.0, disparity * inverse_z)
    rows = [  # from (w, v) to (v, w)
        np.column_stack(np.broadcast_arrays(*row[3:], *row[:3], x)[:6])
        for row in (*image_jacobian(x, y, inverse_z), of_disparity)
    ]
    return rig.f_px * np.stack(rows, axis=1)


compiled_image_jacobian = compiled(inline="always")(image_jacobian)


def point_jacobian(points_cam: Array, sigma: Array, rig: StereoRig) -> Array:
    """Differentiate u, v and disparity, in sigmas, by (N, 3) points: (N, 3, 3), per metre.

    The (N, 3) standard deviations of u, v and disparity, pixels, may be infinite.
    """
    x, y, z = points_cam.T
    jacobian = np.zeros((len(points_cam), 3, 3))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1
    jacobian[:, :, 2] = np.column_stack([-x / z, -y / z, np.full(len(z), -rig.baseline_m) / z])
    return jacobian * ((rig.f_px / z)[:, None, None] / sigma[:, :, None])


@compiled()
def stereo_residual(
    R: Array, t: Array, point: Array, measured: Array, weight: Array, intrinsics: Array, out: Array
) -> None:
    """Write to `out` the residual (u, v, disparity) of a point that one camera sees, in sigmas.

    R (3, 3) and t (3,) are the camera in the world, metres; measured (3,) is in pixels, the weight
    (3,) one over sigma or zero; the intrinsics are fx, fy, cx, cy, and focal length times baseline.
    """
    fx, fy, cx, cy, fb = intrinsics
    x, y, z = _in_camera(R, t, point)
    out[0] = weight[0] * (fx * x / z + cx - measured[0])
    out[1] = weight[1] * (fy * y / z + cy - measured[1])
    out[2] = weight[2] * (fb / z - measured[2])


@compiled()
def stereo_jacobians(
    R: Array, t: Array, point: Array, weight: Array, intrinsics: Array, by_camera: Array,
    by_point: Array,
) -> None:  # fmt: skip
    """Write the derivatives of `stereo_residual` by camera tangent (w, v), (3, 6), and point.

    The arguments are those of `stereo_residual`; `by_point` is (3, 3), by the point in the world.
    """
    fx, fy, _, _, fb = intrinsics
    x, y, z = _in_camera(R, t, point)
    # Rows (a, 0, c), (0, b, d), (0, 0, e) of d residual / d point in the camera's frame.
    a, b, e = weight[0] * fx / z, weight[1] * fy / z, -weight[2] * fb / (z * z)
    c, d = -a * x / z, -b * y / z
    # The camera moves by (w, v) in its own frame: d point = point x w - v.
    _fill_row(by_camera[0], by_point[0], R, a, 0.0, c, x, y, z)
    _fill_row(by_camera[1], by_point[1], R, 0.0, b, d, x, y, z)
    _fill_row(by_camera[2], by_point[2], R, 0.0, 0.0, e, x, y, z)


@compiled()
def _in_camera(R: Array, t: Array, point: Array) -> tuple[float, float, float]:
    """Transform a point to the camera frame, where R, t is the camera in the world."""
    dx, dy, dz = point[0] - t[0], point[1] - t[1], point[2] - t[2]
    x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
    y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
    z = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
    return x, y, max(z, MIN_DEPTH_M)


@compiled(inline="always")
def _fill_row(
    by_camera: Array, by_point: Array, R: Array, a: float, b: float, c: float, x: float, y: float,
    z: float,
) -> None:  # fmt: skip
    by_camera[0], by_camera[1], by_camera[2] = b * z - c * y, c * x - a * z, a * y - b * x
    by_camera[3], by_camera[4], by_camera[5] = -a, -b, -c
    for k in range(3):
        by_point[k] = a * R[k, 0] + b * R[k, 1] + c * R[k, 2]
