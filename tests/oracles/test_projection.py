"""Every form of the projection's Jacobian against central differences of the projection."""

import numpy as np
import pytest

from vo.contract import se3
from vo.contract.projection import (
    compiled_image_jacobian,
    image_jacobian,
    point_jacobian,
    stereo_jacobians,
    stereo_residual,
)
from vo.contract.rig import StereoRig

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
INTRINSICS = np.array([RIG.f_px, RIG.f_px, RIG.cx_px, RIG.cy_px, RIG.f_px * RIG.baseline_m])
T_WORLD_CAM = se3.exp(np.array([0.3, -1.0, 0.5, 0.2, -0.4, 0.1]))
TURN_FIRST = [3, 4, 5, 0, 1, 2]
"""From the tangents (v, w) of `se3` to (w, v)."""
STEP = 1e-6


@pytest.fixture(scope="module")
def points_cam():
    return np.random.default_rng(0).uniform([-2, -1, 1], [2, 1, 6], (20, 3))


def differences(function, size):
    """(..., size) derivatives of a function of a tangent or a shift (size,), at zero."""
    return np.stack(
        [(function(e) - function(-e)) / (2 * STEP) for e in STEP * np.eye(size)], axis=-1
    )


def seen_by_moved_camera(points_cam):
    def project(tangent):
        return RIG.project(se3.transform(se3.inverse(se3.exp(tangent)), points_cam))

    return differences(project, 6)[..., TURN_FIRST]


def test_image_jacobian_equals_differences(points_cam):
    x, y, z = points_cam.T
    rows = image_jacobian(x / z, y / z, 1 / z)
    ours = np.stack([np.column_stack(np.broadcast_arrays(*row)) for row in rows], axis=1)
    expected = seen_by_moved_camera(points_cam)[:, :2] / RIG.f_px
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-7)
    for i in range(len(points_cam)):
        compiled = compiled_image_jacobian(x[i] / z[i], y[i] / z[i], 1 / z[i])
        np.testing.assert_array_equal(compiled, ours[i])


def test_point_jacobian_equals_differences(points_cam):
    sigma = np.random.default_rng(1).uniform(0.1, 2, points_cam.shape)
    expected = differences(lambda shift: RIG.project(points_cam + shift), 3) / sigma[:, :, None]
    ours = point_jacobian(points_cam, sigma, RIG)
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-5)


def test_stereo_jacobians_equal_differences(points_cam):
    R, t = T_WORLD_CAM[:3, :3], T_WORLD_CAM[:3, 3]
    measured, weight = np.array([300.0, 200.0, 20.0]), np.array([2.0, 3.0, 0.5])
    by_camera, by_point, residual = np.empty((3, 6)), np.empty((3, 3)), np.empty(3)
    for point_cam, moved in zip(points_cam, seen_by_moved_camera(points_cam), strict=True):
        point = se3.transform(T_WORLD_CAM, point_cam[None])[0]
        stereo_residual(R, t, point, measured, weight, INTRINSICS, residual)
        np.testing.assert_allclose(residual, weight * (RIG.project(point_cam) - measured))
        stereo_jacobians(R, t, point, weight, INTRINSICS, by_camera, by_point)
        np.testing.assert_allclose(by_camera, weight[:, None] * moved, rtol=1e-6, atol=1e-4)

        def project(shift, point=point):
            return RIG.project(se3.transform(se3.inverse(T_WORLD_CAM), (point + shift)[None]))[0]

        expected = weight[:, None] * differences(project, 3)
        np.testing.assert_allclose(by_point, expected, rtol=1e-6, atol=1e-4)


def test_stereo_residual_behind_camera_stays_finite():
    residual = np.empty(3)
    behind = np.array([0.1, 0.2, -1.0])
    stereo_residual(np.eye(3), np.zeros(3), behind, np.zeros(3), np.ones(3), INTRINSICS, residual)
    assert np.isfinite(residual).all()
