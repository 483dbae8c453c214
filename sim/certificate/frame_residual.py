"""The residual of one frame: its images and labels against each other and the next frame."""

from collections.abc import Mapping
from dataclasses import dataclass

from sim.camera.camera import FrameExposure
from sim.certificate.blur import CameraMotion
from sim.certificate.photometric import FrameResidual, PhotometricCheck, flow_error
from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig


@dataclass(frozen=True)
class FrameView:
    """Exposure of a frame, its rectified images (H, W[, 3]) uint8 and the left camera (4, 4)."""

    exposure: FrameExposure
    left: Image
    right: Image
    T_world_cam: Array


def frame_residual(
    check: PhotometricCheck,
    motion: CameraMotion,
    rig: StereoRig,
    labels: Mapping[str, Array],
    now: FrameView,
    then: FrameView | None,
) -> FrameResidual:
    """Compare a frame's labels by name, of the true rig, with its images and the next frame.

    `disparity` is needed; the flow is compared with images where there is `covisibility`, and with
    the true poses where there is `depth`.
    """
    disparity, depth_m = labels["disparity"], labels.get("depth")
    stereo = check.stereo(now.left, now.right, disparity, now.exposure)
    flow, geometry_px = None, None
    if then and "flow" in labels:
        if "covisibility" in labels:
            exposures = now.exposure, then.exposure
            apart = (motion.displacement_px(x, disparity) for x in exposures)
            forward = labels["flow"], labels["covisibility"]
            flow = check.flow(now.left, then.left, *forward, exposures, sum(apart))
        if depth_m is not None:
            T_next_now = se3.inverse(then.T_world_cam) @ now.T_world_cam
            geometry_px = flow_error(rig, depth_m, labels["flow"], T_next_now)
    return FrameResidual(now.exposure.timestamp_ns, stereo, flow, geometry_px)
