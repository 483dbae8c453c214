"""Stereo benchmarks: KITTI stereo 2015, Middlebury and SceneFlow.

Source: Menze, Geiger, Object scene flow for autonomous vehicles, CVPR 2015, and its development
kit; Scharstein et al., High-resolution stereo datasets with subpixel-accurate ground truth, GCPR
2014; Mayer et al., A large dataset to train convolutional networks for disparity, optical flow and
scene flow estimation, CVPR 2016; PFM: Debevec, http://www.pauldebevec.com/Research/HDR/PFM.
"""

from pathlib import Path

import numpy as np

from sim.dataset.image_codecs import encode_png
from trials.formats.folder import Advance, put
from trials.formats.kitti import projections, row_of
from trials.formats.recording import VISIBLE, Recording
from trials.formats.tum import to_levels
from vo.contract.arrays import Array

LEVELS_PER_PX = 256
"""Of KITTI's disparities."""
SEEN_BY_BOTH, SEEN_BY_ONE, UNKNOWN = 255, 128, 0
"""Levels of Middlebury's masks."""


def write_kitti_stereo(recording: Recording, out: Path, advance: Advance) -> None:
    """Write training/image_2, image_3, disp_occ_0, disp_noc_0 (with occlusion labels) and calib.

    Disparity is rounded to 1/256 px; 0 where it is unknown or beyond 255.996 px.

    Raises:
        DatasetError: If there are no labels of depth or disparity.
    """
    training = out / "training"
    rig = recording.rig
    size = f"{rig.width_px:.6e} {rig.height_px:.6e}"
    calibration = f"S_rect_02: {size}\nS_rect_03: {size}\n" + "".join(
        f"P_rect_0{k}: {row_of(P)}\n" for k, P in enumerate(projections(rig), start=2)
    )
    for i in range(len(recording)):
        name = f"{i:06d}_10.png"
        levels = to_levels(recording.disparity(i), LEVELS_PER_PX)
        for eye, data in zip(("image_2", "image_3"), recording.eyes(i), strict=True):
            put(training / eye / name, data)
        put(training / "disp_occ_0" / name, encode_png(levels))
        hidden = recording.label("occlusion", i)
        if hidden is not None:
            seen = np.where(hidden == VISIBLE, levels, 0).astype(np.uint16)
            put(training / "disp_noc_0" / name, encode_png(seen))
        put(training / "calib_cam_to_cam" / f"{i:06d}.txt", calibration)
        advance(i)


def write_middlebury(recording: Recording, out: Path, advance: Advance) -> None:
    """Write a folder per frame: im0.png, im1.png, disp0.pfm, mask0nocc.png and calib.txt.

    The mask needs occlusion labels; disp1.pfm is written with labels of the right disparity.
    Disparity is infinite where it is unknown; the baseline is in millimetres.

    Raises:
        DatasetError: If there are no labels of depth or disparity.
    """
    for i in range(len(recording)):
        scene = out / f"{recording.name}_{i:06d}"
        disparity = recording.disparity(i)
        for name, data in zip(("im0.png", "im1.png"), recording.eyes(i), strict=True):
            put(scene / name, data)
        put(scene / "disp0.pfm", encode_pfm(_infinite(disparity)))
        right, hidden = (recording.label(x, i) for x in ("disparity_right", "occlusion"))
        if right is not None:
            put(scene / "disp1.pfm", encode_pfm(_infinite(right)))
        if hidden is not None:
            mask = np.where(hidden == VISIBLE, SEEN_BY_BOTH, SEEN_BY_ONE)
            mask[np.isnan(disparity)] = UNKNOWN
            put(scene / "mask0nocc.png", encode_png(mask.astype(np.uint8)))
        put(scene / "calib.txt", _middlebury_calibration(recording, disparity))
        advance(i)


def write_sceneflow(recording: Recording, out: Path, advance: Advance) -> None:
    """Write frames_cleanpass and disparity, and optical_flow where the dataset has it.

    Disparity is that of each eye whose label exists, positive, NaN where it is unknown; flow has
    the channels u, v and 0.

    Raises:
        DatasetError: If there are no labels of depth or disparity.
    """
    name = recording.name
    for i in range(len(recording)):
        for eye, data in zip(("left", "right"), recording.eyes(i), strict=True):
            put(out / "frames_cleanpass" / name / eye / f"{i:04d}.png", data)
        disparities = recording.disparity(i), recording.label("disparity_right", i)
        for eye, values in zip(("left", "right"), disparities, strict=True):
            if values is not None:
                put(out / "disparity" / name / eye / f"{i:04d}.pfm", encode_pfm(values))
        flow = recording.label("flow", i)
        if flow is not None:
            motion = np.dstack([flow[..., :2], np.zeros_like(flow[..., 0])])
            path = f"{name}/into_future/left/OpticalFlowIntoFuture_{i:04d}_L.pfm"
            put(out / "optical_flow" / path, encode_pfm(motion))
        advance(i)


def encode_pfm(values: Array) -> bytes:
    """Encode (H, W) or (H, W, 3) float32 as little-endian PFM, whose rows go from bottom to top."""
    kind = "PF" if values.ndim == 3 else "Pf"
    head = f"{kind}\n{values.shape[1]} {values.shape[0]}\n-1.0\n"
    return head.encode() + np.ascontiguousarray(values[::-1], "<f4").tobytes()


def _infinite(disparity: Array) -> Array:
    return np.where(np.isnan(disparity), np.inf, disparity)


def _middlebury_calibration(recording: Recording, disparity: Array) -> str:
    """Return calib.txt of a frame; the bounds of disparity are those of its label, rounded out."""
    rig = recording.rig
    camera = f"[{rig.f_px} 0 {rig.cx_px}; 0 {rig.f_px} {rig.cy_px}; 0 0 1]"
    known = disparity[np.isfinite(disparity)]
    least, most = (int(np.floor(known.min())), int(np.ceil(known.max()))) if len(known) else (0, 0)
    values = {
        "cam0": camera,
        "cam1": camera,
        "doffs": 0,
        "baseline": rig.baseline_m * 1000,
        "width": rig.width_px,
        "height": rig.height_px,
        "ndisp": most + 1,
        "vmin": least,
        "vmax": most,
    }
    return "".join(f"{key}={value}\n" for key, value in values.items())
