"""What is shown of a recording: images, true poses, labels and scene."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from sim.labels.formats import label_file, read_label
from trials.evaluation.alignment import true_poses
from trials.evaluation.truth import true_rig
from trials.report.trajectory_plot import ground_axes
from trials.view.scene_model import SceneModel, read_scene_model
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.recordings.pairing import FrameSelection
from vo.recordings.readers import label_readers, open_sequence, read_frame_times, read_truth

DEPTH = ("depth", "disparity")
"""Labels from which depth is shown."""
MM_PER_M = 1000
MAX_MM = 65535
"""Largest depth of a 16-bit image."""


@dataclass(frozen=True)
class ViewedRecording:
    """What is shown of a recording of N frames.

    Attributes:
        folder: Of the recording.
        sequence: Images, times and calibration.
        numbers: (N,) of the frames in the whole recording.
        truth: True trajectory; None without.
        T_world_cam: (N, 4, 4) true poses; NaN where unknown, or without attitude.
        labels: Readers of depth or disparity by name, each of which takes the time of a frame.
        scene: Triangles of the world; None of recordings of other origin.
    """

    folder: Path
    sequence: StereoSequence
    numbers: Indices
    truth: Trajectory | None
    T_world_cam: Array
    labels: Mapping[str, Callable[[int], Array]]
    scene: SceneModel | None

    @property
    def rig(self) -> StereoRig:
        """The calibration."""
        return self.sequence.rig

    @cached_property
    def positions(self) -> Array:
        """(N, 3) true positions that are shown, metres in the world."""
        truth = self.truth
        if truth is None or truth.point_cam is None:
            return self.T_world_cam[:, :3, 3]
        return true_poses(truth, self.sequence.timestamps_ns)[:, :3, 3]

    def up(self, estimated: Array) -> Array:
        """Return the axis (3,) of the world that points up, of cameras with y down.

        Without true poses, those of estimated ones (M, 4, 4) or of the carrier count.
        """
        if self.truth is not None and self.truth.point_cam is not None:
            return np.array([0.0, 0.0, 1.0])
        known = self.T_world_cam[~np.isnan(self.T_world_cam[:, 0, 0])]
        poses = next((x for x in (known, estimated) if len(x)), self.rig.T_body_cam[None])
        return np.cross(*ground_axes(poses))

    def depth_mm(self, i: int) -> Array | None:
        """Return the depth (H, W) uint16 of frame i in mm; 0 where it is unknown or beyond 65 m."""
        time_ns = int(self.sequence.timestamps_ns[i])
        if "depth" in self.labels:
            depth_m = self.labels["depth"](time_ns)
        elif "disparity" in self.labels:
            is_own = (self.folder / MANIFEST).is_file()
            rig = true_rig(self.folder, read_manifest(self.folder)) if is_own else self.rig
            depth_m = rig.triangulate(np.zeros((1, 1, 2)), self.labels["disparity"](time_ns))[
                ..., 2
            ]
        else:
            return None
        mm = np.nan_to_num(depth_m * MM_PER_M, nan=0.0, posinf=0.0)
        return np.where(mm <= MAX_MM, np.rint(mm), 0).astype(np.uint16)

    @cached_property
    def _true_rig(self) -> StereoRig:
        """The camera to which labels belong."""
        is_own = (self.folder / MANIFEST).is_file()
        return true_rig(self.folder, read_manifest(self.folder)) if is_own else self.rig


def open_recording(folder: Path, frames: FrameSelection) -> ViewedRecording:
    """Open the selected frames of a recording, and what it has of truth, labels and scene.

    Raises:
        DriftyardError: As `open_sequence` and `read_truth`.
    """
    sequence, truth = open_sequence(folder, frames), read_truth(folder)
    times_ns = sequence.timestamps_ns
    poses = np.full((len(times_ns), 4, 4), np.nan)
    if truth is not None and truth.point_cam is None:
        poses = true_poses(truth, times_ns)
    root = folder.resolve().parent if folder.resolve().name == "mav0" else folder
    own = {x: partial(read_label, root, x) for x in DEPTH if label_file(root, x, 0).parent.is_dir()}
    numbers = np.searchsorted(read_frame_times(folder), times_ns)
    scene = read_scene_model(root)
    labels = own or {x: read for x, read in label_readers(folder).items() if x in DEPTH}
    return ViewedRecording(root, sequence, numbers, truth, poses, labels, scene)
