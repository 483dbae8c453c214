"""TUM RGB-D: left images, depth of 16 bits, associations and poses.

Source: Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012, and its page
on file formats.
"""

from pathlib import Path

import numpy as np

from sim.dataset.image_codecs import encode_png
from trials.formats.folder import Advance, put
from trials.formats.recording import Recording
from vo.contract.arrays import Array
from vo.contract.remarks import remark
from vo.contract.trajectory import TUM_HEADER, Trajectory, tum_lines

LEVELS_PER_M = 5000
MAX_LEVEL = np.iinfo(np.uint16).max


def write_tum_rgbd(recording: Recording, out: Path, advance: Advance) -> None:
    """Write rgb, depth, their lists, associations.txt, groundtruth.txt and camera.yaml.

    Depth is rounded to 0.2 mm; 0 where it is unknown or beyond 13.107 m, which is remarked.

    Raises:
        DatasetError: If there are no labels of depth or disparity.
    """
    poses = Trajectory(recording.sequence.timestamps_ns, recording.poses)
    stamps = [recording.seconds(i) for i in range(len(recording))]
    beyond: list[float] = []
    for i, stamp in enumerate(stamps):
        depth_m = recording.depth(i)
        beyond.append(float((depth_m * LEVELS_PER_M > MAX_LEVEL).mean()))
        put(out / f"rgb/{stamp}.png", recording.eyes(i)[0])
        put(out / f"depth/{stamp}.png", encode_png(to_levels(depth_m, LEVELS_PER_M)))
        advance(i)
    if any(beyond):
        share = sum(beyond) / len(beyond)
        remark(f"{recording.folder}: {share:.1%} of the depths exceed 13.107 m and are set to 0")
    for kind, title in (("rgb", "color images"), ("depth", "depth maps")):
        head = f"# {title}\n# file: '{recording.name}'\n# timestamp filename\n"
        put(out / f"{kind}.txt", head + "".join(f"{x} {kind}/{x}.png\n" for x in stamps))
    pairs = (f"{x} rgb/{x}.png {x} depth/{x}.png\n" for x in stamps)
    put(out / "associations.txt", "".join(pairs))
    put(out / "groundtruth.txt", "\n".join([TUM_HEADER, *tum_lines(poses)]) + "\n")
    put(out / "camera.yaml", _camera(recording))


def to_levels(values: Array, levels_per_unit: int) -> Array:
    """Round positive values (H, W) to uint16 levels from 1 on; 0 for NaN and what is beyond."""
    levels = np.rint(np.nan_to_num(values.astype(np.float64), posinf=0.0) * levels_per_unit)
    known = (values > 0) & (levels <= MAX_LEVEL)
    return np.where(known, np.maximum(levels, 1), 0).astype(np.uint16)


def _camera(recording: Recording) -> str:
    """Return the calibration under the keys of ORB-SLAM's settings for RGB-D cameras."""
    rig = recording.rig
    values = {
        "fx": rig.f_px,
        "fy": rig.f_px,
        "cx": rig.cx_px,
        "cy": rig.cy_px,
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        "width": rig.width_px,
        "height": rig.height_px,
        "bf": rig.f_px * rig.baseline_m,
    }
    lines = [f"Camera.{key}: {value}" for key, value in values.items()]
    return "\n".join(["%YAML:1.0", *lines, f"DepthMapFactor: {float(LEVELS_PER_M)}"]) + "\n"
