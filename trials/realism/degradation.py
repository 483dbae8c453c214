"""Disturbances of the simulator, applied to the images of a real recording.

Lens, sensor, calibration and lost frames are those of the simulator. What depends on motion within
a frame (blur, rolling shutter, a late right eye) moves pixels along the optical flow between
successive images, which is estimated and thus wrong at occlusions and where motion is large. Fog
depends on distances, which are estimated by stereo, and wrong where there is no texture.

Source of the flow: Kroeger, Timofte, Dai and Van Gool, Fast optical flow using dense inverse
search, ECCV 2016, by OpenCV.
"""

import json
import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import yaml

from sim.dataset.image_codecs import encode_png
from sim.disturbances import DISTURBANCES, disturbed, parse_disturbances
from sim.imaging.fog import foggy
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.lens import delivered_rig, margin_px, raw_margin_px
from sim.imaging.linear_light import levels_to_light
from sim.imaging.soiling import Soiling
from sim.settings import RecordSettings
from sim.world.random_streams import stream
from trials.formats.folder import new_folder, put
from trials.realism.stereo_range import estimate_ranges
from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.errors import SettingsError
from vo.contract.remarks import remark
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoSequence
from vo.recordings.pairing import ALL_FRAMES, FrameSelection
from vo.recordings.readers import open_sequence, read_truth

MOTION = ("exposure.time_ms", "exposure.line_time_us", "exposure.right_offset_ms")
"""Settings whose effect depends on motion within a frame."""
GROUPS = ("sensor.", "calibration.", "weather.fog")
"""Beginnings of the settings that apply to images, or to images and distances."""
MAX_SUBFRAMES = 32
IMAGES = ("cam0", "cam1", "raw0", "raw1")
"""Folders of images, which are not carried over."""
STATES = "mav0/state_groundtruth_estimate0"


def applicable() -> list[str]:
    """Return the names of the disturbances that apply to a real recording."""
    return [
        name
        for name, x in DISTURBANCES.items()
        if all(key in MOTION or key.startswith(GROUPS) for key in x.recipe)
    ]


def degrade_recording(
    real: Path,
    disturb: str,
    out: Path,
    seed: int = 0,
    frames: FrameSelection = ALL_FRAMES,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a recording, rectified and disturbed, as a new folder in EuRoC's layout.

    A remark says so where motion within a frame is estimated.

    Raises:
        SettingsError: If a disturbance is unknown, needs the simulator, or its strength is wrong.
        DatasetError: If the recording is unreadable, or `out` exists or cannot be written.
    """
    wanted = parse_disturbances(disturb)
    valid = applicable()
    if needing := [x for x in wanted if x not in valid]:
        raise SettingsError(
            f"disturbance {needing[0]} needs the simulator; valid on recordings: {', '.join(valid)}"
        )
    if not wanted:
        raise SettingsError(f"names no disturbance; valid on recordings: {', '.join(valid)}")
    sequence = open_sequence(real, frames)
    settings = _settings(sequence, wanted)
    kept = stream(seed, "drop").random(len(sequence)) >= settings.sensor.drop_share
    kept[0] = True
    rows = np.flatnonzero(kept).tolist()
    camera = _Camera(sequence, settings, seed)
    with new_folder(out) as folder:
        for done, i in enumerate(rows, 1):
            for k, image in enumerate(camera.images(i)):
                time_ns = int(sequence.timestamps_ns[i])
                put(folder / f"mav0/cam{k}/data/{time_ns}.png", encode_png(image))
            if progress:
                progress(done, len(rows))
        delivered = delivered_rig(sequence.rig, settings.calibration)
        line_time_s = delivered.line_time_s + settings.exposure.line_time_us * 1e-6
        delivered = replace(delivered, line_time_s=line_time_s)
        _write_cameras(folder, delivered, [int(sequence.timestamps_ns[i]) for i in rows])
        _carry_over(real, sequence.rig, folder)
        about = {"source": sequence.name, "disturb": wanted, "seed": seed}
        put(folder / "degraded.json", json.dumps(about, indent=1) + "\n")
    if camera.needs_motion:
        remark(
            f"{out}: motion within a frame is estimated by optical flow between images, which is "
            "wrong at occlusions and where it is large"
        )
    if settings.weather.fog_m:
        remark(
            f"{out}: distances in fog are estimated by stereo matching, which is wrong where "
            "nothing matches: the sky, plain walls, the margins of the images"
        )


def _settings(sequence: StereoSequence, wanted: Mapping[str, float]) -> RecordSettings:
    steps = np.diff(sequence.timestamps_ns)
    rate_hz = 1e9 / float(np.median(steps)) if len(steps) else 1.0
    rig = {"rate_hz": min(max(rate_hz, 1.0), 240.0), "height_px": sequence.rig.height_px}
    return disturbed(RecordSettings.model_validate({"rig": rig}), wanted)


@dataclass
class _Camera:
    """Lens and sensor of both eyes, which take the images of a recording again."""

    sequence: StereoSequence
    settings: RecordSettings
    seed: int

    def __post_init__(self) -> None:
        rig, m = self.sequence.rig, margin_px(self.settings, self.sequence.rig)
        size = {"width_px": rig.width_px + 2 * m, "height_px": rig.height_px + 2 * m}
        rendered = replace(rig, **size, cx_px=rig.cx_px + m, cy_px=rig.cy_px + m)
        self._margin = m
        self._sensors = (
            ImageSensor(self.settings, 0, rig, rendered, self._dirt(0)),
            ImageSensor(self.settings, 1, rig, rendered, self._dirt(1)),
        )
        levels = levels_to_light(self.settings.sensor.response, np.arange(256))
        self._light = levels.astype(np.float32)
        exposure = self.settings.exposure
        values = exposure.time_ms, exposure.line_time_us, exposure.right_offset_ms
        self.needs_motion = any(values) and len(self.sequence) > 1

    def _dirt(self, k: int) -> Soiling | None:
        """Draw the dirt on a lens."""
        amount, rig = self.settings.sensor.soiling, self.sequence.rig
        m = raw_margin_px(self.settings, rig)
        size = rig.height_px + 2 * m, rig.width_px + 2 * m
        return Soiling(amount, size, stream(self.seed, f"soiling/{k}")) if amount else None

    def images(self, i: int) -> list[Image]:
        """Take the left and the right image of frame i again: (H, W) uint8 each."""
        return [self._image(i, k, sensor) for k, sensor in enumerate(self._sensors)]

    def _image(self, i: int, k: int, sensor: ImageSensor) -> Image:
        light = self._exposed(i, k) if self.needs_motion else self._decode(i, k)
        m = self._margin
        padded = cv2.copyMakeBorder(light, m, m, m, m, cv2.BORDER_REFLECT_101)
        rng = stream(self.seed, f"noise/{k}/{i}")
        return sensor.undistort(sensor.expose(np.asarray(padded), 1.0, 1.0, rng))

    def _load(self, i: int, k: int) -> Image:
        frame = self.sequence[i]
        return frame.right if k else frame.left

    def _decode(self, i: int, k: int) -> Array:
        """Return the light (H, W) of the image, in fog if there is any."""
        light = np.asarray(cv2.LUT(self._load(i, k), self._light))
        if not self.settings.weather.fog_m:
            return light
        ranges = estimate_ranges(self.sequence.rig, self._load(i, 0), self._load(i, 1))
        return foggy(light, ranges[k], self.settings.weather.fog_m)

    def _exposed(self, i: int, k: int) -> Array:
        """Return the light (H, W) of an exposure while the image moves."""
        other = i + 1 if i + 1 < len(self.sequence) else i - 1
        image = self._load(i, k)
        times = self.sequence.timestamps_ns
        period_ms = float(times[other] - times[i]) * 1e-6
        flow = _flow(image, self._load(other, k))
        exposure = self.settings.exposure
        rows = np.arange(len(image), dtype=np.float32) - (len(image) - 1) / 2
        delay_ms = 1e-3 * exposure.line_time_us * rows + k * exposure.right_offset_ms
        speed = float(np.quantile(np.hypot(*np.moveaxis(flow, -1, 0)), 0.99)) / abs(period_ms)
        count = min(max(math.ceil(speed * exposure.time_ms), 1), MAX_SUBFRAMES)
        at_ms = exposure.time_ms * ((np.arange(count) + 0.5) / count - 0.5)
        light = self._decode(i, k)
        total = sum((move(light, flow, (delay_ms + x) / period_ms) for x in at_ms), 0 * light)
        return total / np.float32(count)


def move(light: Array, flow: Array, share: Array) -> Array:
    """Move an image (H, W) along its flow (H, W, 2) by a share (H,) of it, by row."""
    height, width = light.shape
    v, u = np.mgrid[:height, :width].astype(np.float32)
    du, dv = np.moveaxis(flow * np.asarray(share, np.float32)[:, None, None], -1, 0)
    return cv2.remap(light, u - du, v - dv, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _flow(image: Image, other: Image) -> Array:
    """Estimate the optical flow (H, W, 2) from an image to another."""
    finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    return np.asarray(finder.calc(image, other, None))  # pyrefly: ignore


def _write_cameras(folder: Path, rig: StereoRig, times_ns: list[int]) -> None:
    for k in (0, 1):
        T = rig.T_body_cam @ se3.pose(np.eye(3), np.array([k * rig.baseline_m, 0.0, 0.0]))
        sheet = {
            "sensor_type": "camera",
            "comment": "rectified image of a recording that was disturbed",
            "T_BS": {"cols": 4, "rows": 4, "data": T.ravel().tolist()},
            "resolution": [rig.width_px, rig.height_px],
            "camera_model": "pinhole",
            "intrinsics": [rig.f_px, rig.f_px, rig.cx_px, rig.cy_px],
            "distortion_model": "radial-tangential",
            "distortion_coefficients": [0.0] * 4,
        }
        sheet |= {"line_delay": rig.line_time_s} if rig.line_time_s else {}
        put(folder / f"mav0/cam{k}/sensor.yaml", yaml.safe_dump(_plain(sheet), sort_keys=False))
        rows = "".join(f"{t},{t}.png\n" for t in times_ns)
        put(folder / f"mav0/cam{k}/data.csv", "#timestamp [ns],filename\n" + rows)


def _carry_over(real: Path, rig: StereoRig, folder: Path) -> None:
    """Copy what stands beside the images; of other layouts, write the truth in this one."""
    root = real if real.is_dir() and real.resolve().name == "mav0" else real / "mav0"
    if (root / "cam0").is_dir():
        for part in sorted(root.iterdir()):
            if part.is_dir() and part.name not in IMAGES:
                shutil.copytree(part, folder / "mav0" / part.name)
        return
    truth = read_truth(real)
    if truth is None:
        return
    origin = np.eye(4)
    if truth.point_cam is None:
        T_world_body = truth.T_ref_frame @ se3.inverse(rig.T_body_cam)
        parts = [T_world_body[:, :3, 3], se3.to_quat_wxyz(T_world_body)]
    else:
        parts = [truth.T_ref_frame[:, :3, 3]]
        origin[:3, 3] = se3.transform(rig.T_body_cam, truth.point_cam[None])[0]
    names = "timestamp [ns],px [m],py [m],pz [m]" + ",qw,qx,qy,qz" * (len(parts) == 2)
    rows = zip(truth.timestamps_ns.tolist(), np.hstack(parts).tolist(), strict=True)
    text = "".join(f"{t},{','.join(map(repr, row))}\n" for t, row in rows)
    put(folder / f"{STATES}/data.csv", f"#{names}\n{text}")
    sheet = {"T_BS": {"cols": 4, "rows": 4, "data": origin.ravel().tolist()}}
    put(folder / f"{STATES}/sensor.yaml", yaml.safe_dump(sheet, sort_keys=False))


def _plain(content: Mapping[str, object]) -> dict[str, object]:
    """Return content without NumPy's numbers, which YAML does not write."""
    return json.loads(json.dumps(content, default=float))
