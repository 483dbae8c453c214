"""What the writers of all formats read: images, calibration, true poses and labels of a dataset."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sim.dataset.image_codecs import encode_png
from sim.labels.formats import FORWARD, LABELS, label_file, read_label
from trials.evaluation.alignment import true_poses
from trials.evaluation.truth import true_rig
from vo.contract.arrays import Array, Mask
from vo.contract.dataset import MANIFEST, RECTIFIED_EYE, read_manifest
from vo.contract.errors import DatasetError
from vo.contract.remarks import remark
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import NS_PER_S
from vo.recordings.pairing import FrameSelection
from vo.recordings.readers import (
    label_readers,
    open_sequence,
    read_frame_times,
    read_truth,
    recording_name,
)

CAMERAS = ("cam0", "cam1")
VISIBLE = 0
"""Code of the labels `occlusion` and `covisibility` for pixels that the other image shows."""


@dataclass(frozen=True)
class Recording:
    """N >= 1 frames of a dataset or recording.

    Attributes:
        folder: Of the dataset.
        name: Of that folder.
        sequence: Calibration, times and rectified grey images.
        poses: (N, 4, 4) true T_world_cam; NaN where the truth has none.
        consecutive: (N,) whether the next frame is the next one of the dataset, as labels of
            motion expect.
        manifest: Content of dataset.json; None for recordings of other origin.
        copied: Whether the image files are rectified, so that their bytes are copied.
    """

    folder: Path
    name: str
    sequence: StereoSequence
    poses: Array
    consecutive: Mask
    manifest: Mapping[str, Any] | None
    copied: bool

    def __len__(self) -> int:
        return len(self.sequence)

    @property
    def rig(self) -> StereoRig:
        """The delivered calibration."""
        return self.sequence.rig

    @property
    def times_ns(self) -> list[int]:
        """Times of the N frames."""
        return self.sequence.timestamps_ns.tolist()

    def pose(self, i: int) -> Array | None:
        """Return the true T_world_cam (4, 4) of frame i; None if the truth has none."""
        return None if np.isnan(self.poses[i]).any() else self.poses[i]

    @cached_property
    def labels(self) -> Mapping[str, Callable[[int], Array]]:
        """Readers of the labels by name; each takes the time of a frame."""
        if self.manifest is None:
            return label_readers(self.folder)
        own = (x for x in LABELS if label_file(self.folder, x, 0).parent.is_dir())
        return {x: partial(read_label, self.folder, x) for x in own}

    @cached_property
    def true_rig(self) -> StereoRig:
        """The camera to which the labels belong."""
        return self.rig if self.manifest is None else true_rig(self.folder, self.manifest)

    def seconds(self, i: int) -> str:
        """Return the time of frame i in seconds with nine decimals."""
        seconds, nanoseconds = divmod(self.times_ns[i], NS_PER_S)
        return f"{seconds}.{nanoseconds:09d}"

    def eyes(self, i: int) -> tuple[bytes, bytes]:
        """Return both images of frame i as PNG files: grey, or in the colour of the dataset.

        Raises:
            ImageError: If an image is damaged.
        """
        frame = self.sequence[i]
        if not self.copied:
            return encode_png(frame.left), encode_png(frame.right)
        name = f"{frame.timestamp_ns}.png"
        left, right = (
            (self.folder / "mav0" / camera / "data" / name).read_bytes() for camera in CAMERAS
        )
        return left, right

    def pixels(self, i: int) -> tuple[Array, Array]:
        """Return both images of frame i, (H, W) or (H, W, 3) RGB, uint8."""
        left, right = (
            cv2.imdecode(np.frombuffer(x, np.uint8), cv2.IMREAD_UNCHANGED) for x in self.eyes(i)
        )
        return _rgb(np.asarray(left)), _rgb(np.asarray(right))

    def has(self, label: str) -> bool:
        """Whether the recording has a label."""
        return label in self.labels

    def label(self, label: str, i: int) -> Array | None:
        """Read a label of frame i.

        It is None if the recording lacks it, or it is of the motion to a frame that is left out.

        Raises:
            ImageError: If the file is missing or damaged.
        """
        if not self.has(label) or (label in FORWARD and not self.consecutive[i]):
            return None
        return self.labels[label](self.times_ns[i])

    @property
    def has_depth(self) -> bool:
        """Whether the dataset has depth or disparity of the left image."""
        return self.has("depth") or self.has("disparity")

    def depth(self, i: int) -> Array:
        """Return planar depth (H, W) float32 of the left pixels in metres; NaN where unknown.

        Raises:
            DatasetError: If the dataset has labels of neither depth nor disparity.
        """
        depth_m = self.label("depth", i)
        if depth_m is not None:
            return depth_m
        disparity_px = self.disparity(i)
        return self._depth_factor / disparity_px

    def disparity(self, i: int) -> Array:
        """Return u_left - u_right (H, W) float32 of the left pixels; NaN where unknown.

        Raises:
            DatasetError: If the dataset has labels of neither depth nor disparity.
        """
        label = "disparity" if self.has("disparity") else "depth"
        values = self.label(label, i)
        if values is None:
            hint = "; generate it with labels.depth=true" if self.manifest else ""
            raise DatasetError(
                f"{self.folder}: has no labels of depth or disparity, which this format needs{hint}"
            )
        return values if label == "disparity" else self._depth_factor / values

    @property
    def _depth_factor(self) -> np.float32:
        return np.float32(self.true_rig.f_px * self.true_rig.baseline_m)


def open_recording(folder: Path, frames: FrameSelection, needs_poses: bool) -> Recording:
    """Open the selected frames of a dataset or recording, with what it has of truth and labels.

    If poses are needed, frames without a true pose are left out, with a remark.

    Raises:
        DriftyardError: As `open_sequence` and `read_truth`; also if poses are needed, and there is
            no truth, it has no attitude, or no pose at the time of any frame.
    """
    sequence = open_sequence(folder, frames)
    root = folder.resolve().parent if folder.resolve().name == "mav0" else folder
    manifest = _manifest(root) if (root / MANIFEST).is_file() else None
    sheet = root / "mav0/cam0/sensor.yaml"
    copied = manifest is not None and RECTIFIED_EYE in sheet.read_text(errors="replace")
    if manifest is not None and _is_miscalibrated(manifest):
        remark(f"{root}: labels are those of the true camera, which differs from the calibration")
    poses = _poses(folder, sequence, needs_poses)
    if needs_poses and np.isnan(poses).any():
        rows = np.flatnonzero(~np.isnan(poses[:, 0, 0])).tolist()
        if not rows:
            raise DatasetError(f"{folder}: no frame has a true pose, which this format needs")
        count = len(sequence) - len(rows)
        remark(f"{folder}: {count} frames have no true pose and are left out")
        sequence, poses = _select(sequence, rows), poses[rows]
    every = np.searchsorted(read_frame_times(folder), sequence.timestamps_ns)
    consecutive = np.append(np.diff(every) == 1, False)
    return Recording(root, recording_name(root), sequence, poses, consecutive, manifest, copied)


def _poses(folder: Path, sequence: StereoSequence, needs_poses: bool) -> Array:
    """Return T_world_cam (N, 4, 4), NaN outside of the truth."""
    truth = read_truth(folder)
    if truth is not None and truth.point_cam is None:
        return true_poses(truth, sequence.timestamps_ns)
    what = "has no ground truth" if truth is None else "has a truth of positions without attitude"
    if needs_poses:
        raise DatasetError(f"{folder}: {what}; this format needs true poses")
    remark(f"{folder}: {what}; it is exported without poses")
    return np.full((len(sequence), 4, 4), np.nan)


def _select(sequence: StereoSequence, rows: list[int]) -> StereoSequence:
    return replace(
        sequence,
        timestamps_ns=sequence.timestamps_ns[rows],
        load=lambda i: sequence.load(rows[i]),
    )


def _manifest(root: Path) -> Mapping[str, Any]:
    """Read dataset.json, with entries of their kinds."""
    manifest = read_manifest(root)
    for key, kind in {"scene": dict, "things": list, "rig": dict, "rig_true": dict}.items():
        if not isinstance(manifest.setdefault(key, kind()), kind):
            raise DatasetError(f"{root / MANIFEST}: {key} is malformed")
    return manifest


def _is_miscalibrated(manifest: Mapping[str, Any]) -> bool:
    R = manifest["rig_true"].get("R_nominal_right", np.eye(3))
    true = {key: x for key, x in manifest["rig_true"].items() if key != "R_nominal_right"}
    return true != manifest["rig"] or not np.array_equal(R, np.eye(3))


def _rgb(image: Array) -> Array:
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])
