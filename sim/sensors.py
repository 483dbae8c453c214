"""What each sensor folder says of itself: the content of its sensor.yaml."""

from typing import Any

import numpy as np

from sim.rover import TRACK_M, WHEEL_RADIUS_M
from sim.settings import EncoderSettings, RecordSettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

LABELS = {
    "depth": "planar depth of the left camera: distance along the optical axis, at pixel centres",
    "disparity": "u_left - u_right of the left camera's pixels: f * baseline / depth",
}
LABEL_UNITS = {"depth": "m", "disparity": "px"}


def camera_sheet(rig: StereoRig, rate_hz: float, eye: int) -> dict[str, Any]:
    """Describe camera 0 (left) or 1 (right), in EuRoC's keys."""
    T_left_eye = se3.pose(np.eye(3), np.array([rig.baseline_m * eye, 0.0, 0.0]))
    return {
        "sensor_type": "camera",
        "comment": f"{('left', 'right')[eye]} eye of a rectified pair, pixel centres on integers",
        "T_BS": _matrix(rig.T_body_cam @ T_left_eye),
        "rate_hz": rate_hz,
        "resolution": [rig.width_px, rig.height_px],
        "camera_model": "pinhole",
        "intrinsics": [rig.f_px, rig.f_px, rig.cx_px, rig.cy_px],
        "distortion_model": "radial-tangential",
        "distortion_coefficients": [0.0, 0.0, 0.0, 0.0],
    }


def label_sheet(rig: StereoRig, rate_hz: float, label: str) -> dict[str, Any]:
    """Describe one of LABELS; its pixels are those of camera 0."""
    return {
        "sensor_type": label,
        "comment": LABELS[label],
        "T_BS": _matrix(rig.T_body_cam),
        "rate_hz": rate_hz,
        "resolution": [rig.width_px, rig.height_px],
        "unit": LABEL_UNITS[label],
        "encoding": "one-channel 32-bit float TIFF, lossless",
        "invalid_value": "nan",
    }


def wheels_sheet(settings: EncoderSettings) -> dict[str, Any]:
    """Describe the wheel encoders."""
    return {
        "sensor_type": "wheel_encoders",
        "comment": "ticks since the start, forward positive; stamps are exact, their spacing is "
        "the sampling period to one physics step",
        "rate_hz": settings.rate_hz,
        "ticks_per_turn": settings.ticks_per_turn,
        "wheel_radius_m": WHEEL_RADIUS_M,
        "track_m": TRACK_M,
    }


def truth_sheet(settings: RecordSettings) -> dict[str, Any]:
    """Describe the true state."""
    return {
        "sensor_type": "truth",
        "comment": "T_world_body at mid-exposure; body: origin midway between the driven wheels, "
        "x forward, y left, z up",
        "T_BS": _matrix(np.eye(4)),
        "rate_hz": settings.rig.rate_hz,
    }


def _matrix(T: Array) -> dict[str, Any]:
    return {"cols": 4, "rows": 4, "data": [float(x) for x in T.ravel()]}
