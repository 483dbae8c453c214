"""Recordings that tests write by hand, independent of the project's own writer."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import yaml

F_PX, BASELINE_M, DISPARITY_PX = 200.0, 0.1, 8.0
WIDTH, HEIGHT = 240, 180
PERIOD_NS = 100_000_000


def wall(frames: int, step_px: int = 4, seed: int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
    """Stereo pairs of a textured wall at F_PX * BASELINE_M / DISPARITY_PX = 2.5 m, the rig moving
    along x by step_px / DISPARITY_PX * BASELINE_M a frame."""
    d = int(DISPARITY_PX)
    width = WIDTH + frames * step_px + d
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 255, (HEIGHT // 4, width // 4 + 1), dtype=np.uint8)
    texture = cv2.resize(coarse, (width, HEIGHT), interpolation=cv2.INTER_CUBIC)
    starts = [i * step_px for i in range(frames)]
    columns = [texture[:, s : s + WIDTH] for s in range(width - WIDTH + 1)]
    return [tuple(map(np.ascontiguousarray, (columns[s], columns[s + d]))) for s in starts]


def write_euroc(
    folder: Path,
    pairs: Sequence[tuple[np.ndarray, np.ndarray]],
    K: np.ndarray | None = None,
    distortion: Sequence[float] = (0, 0, 0, 0),
    T_body_cams: Sequence[np.ndarray] | None = None,
    truth_step_m: float | None = None,
) -> Path:
    """Write mav0/cam0, cam1 and, on request, the truth of a body that moves along its x axis."""
    if K is None:
        K = np.array([[F_PX, 0, (WIDTH - 1) / 2], [0, F_PX, (HEIGHT - 1) / 2], [0, 0, 1]])
    if T_body_cams is None:
        right = np.eye(4)
        right[0, 3] = BASELINE_M
        T_body_cams = (np.eye(4), right)
    times = [(i + 1) * PERIOD_NS for i in range(len(pairs))]
    for eye, T_body_cam in enumerate(T_body_cams):
        camera = folder / "mav0" / f"cam{eye}"
        (camera / "data").mkdir(parents=True)
        sheet = {
            "sensor_type": "camera",
            "T_BS": {"rows": 4, "cols": 4, "data": T_body_cam.ravel().tolist()},
            "camera_model": "pinhole",
            "intrinsics": [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])],
            "resolution": [pairs[0][0].shape[1], pairs[0][0].shape[0]],
            "distortion_model": "radial-tangential",
            "distortion_coefficients": list(distortion),
        }
        (camera / "sensor.yaml").write_text("%YAML:1.0\n" + yaml.safe_dump(sheet))
        rows = "".join(f"{t},{t}.png\n" for t in times)
        (camera / "data.csv").write_text("#timestamp [ns],filename\n" + rows)
        for t, pair in zip(times, pairs, strict=True):
            cv2.imwrite(str(camera / "data" / f"{t}.png"), pair[eye])
    if truth_step_m is not None:
        states = folder / "mav0" / "state_groundtruth_estimate0"
        states.mkdir()
        rows = "".join(f"{t},{i * truth_step_m},0,0,1,0,0,0\n" for i, t in enumerate(times))
        (states / "data.csv").write_text("#timestamp,p,p,p,qw,qx,qy,qz\n" + rows)
    return folder
