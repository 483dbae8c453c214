"""A recording that is open: frames for an estimator, and labels and truth to score it by."""

import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from driftyard.failures import in_one_family
from driftyard.labels import DenseLabels
from driftyard.notebook import data_frame, pose_columns, thumbnails
from trials.evaluation.alignment import true_poses
from trials.evaluation.display import html_display, text_display
from trials.evaluation.truth import true_rig, true_trajectory
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DatasetError, DriftyardError, ImageError
from vo.contract.inertial import ImuLog
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame, StereoSequence, WheelLog
from vo.contract.trajectory import Trajectory
from vo.recordings.pairing import ALL_FRAMES, FrameSelection
from vo.recordings.readers import open_sequence, read_imu

if TYPE_CHECKING:
    import pandas as pd

    from sim.truth.views import FrameViews

PathLike = str | os.PathLike[str]


@dataclass(frozen=True, repr=False, eq=False)
class Dataset(DenseLabels):
    """A stereo recording: N frames, and whatever labels, truth and sensors it has.

    Its length is N; iteration, or an index from 0 (negative ones count from the end), gives
    `StereoFrame`s. A property or method whose data the recording does not have raises a
    DatasetError that says what it has; an index beyond the frames a FrameIndexError, which is an
    IndexError too. Images and labels are read when they are asked for.

    Labels are those of the left image, (H, W), unless stated otherwise; `docs/conventions.md`
    defines each. Without a surface, depth, disparity and flow are NaN.

    Attributes:
        path: Folder of the recording.
        sequence: What an estimator receives: calibration, times and images, without truth.
        selection: The frames of the recording that were chosen.

    Example:
        >>> ds = dy.open("ds")
        >>> for frame in ds:
        ...     assert frame.left.shape == frame.right.shape == (ds.rig.height_px, ds.rig.width_px)
        >>> ds.rig.K.shape, ds.T_world_cam.shape == (len(ds), 4, 4)
        ((3, 3), True)
        >>> f_px, baseline_m = ds.rig.f_px, ds.rig.baseline_m
        >>> bool(np.nanmax(abs(ds.depth(0) * ds.disparity(0) - f_px * baseline_m)) < 1e-4)
        True
        >>> ds.normals(0)
        Traceback (most recent call last):
        vo.contract.errors.DatasetError: ds: has no normals labels, only depth, disparity, flow, \
segmentation; record it with labels.normals=true
    """

    sequence: StereoSequence
    selection: FrameSelection = ALL_FRAMES

    @property
    def name(self) -> str:
        """Name of the recording's folder."""
        return self.sequence.name

    @property
    def rig(self) -> StereoRig:
        """Calibration of the rectified pair: K, baseline_m, T_body_cam, size.

        Labels are those of the true rig, `about["rig_true"]`, which differs from the calibration
        if the recording was asked for that.
        """
        return self.sequence.rig

    @property
    def timestamps_ns(self) -> Indices:
        """(N,) times in the middle of the exposure, ns."""
        return self.sequence.timestamps_ns

    def __len__(self) -> int:
        return len(self.sequence)

    def __getitem__(self, i: int) -> StereoFrame:
        """Load frame i; ImageError if an image is missing or damaged."""
        return self.sequence[self.row(i)]

    def __iter__(self) -> Iterator[StereoFrame]:
        return iter(self.sequence)

    @cached_property
    def about(self) -> Mapping[str, Any]:
        """The manifest `dataset.json`: scene, seed, settings, certificate; else empty."""
        return read_manifest(self._root) if (self._root / MANIFEST).is_file() else {}

    @cached_property
    def truth(self) -> Trajectory:
        """True T_world_cam at the rate of the truth; positions only, where there is no more."""
        return true_trajectory(self.path)

    @cached_property
    def T_world_cam(self) -> Array:
        """(N, 4, 4) true pose of the left camera in each frame; NaN outside of the truth."""
        if self.truth.point_cam is not None:
            raise DatasetError(f"{self.path}: the truth has positions only; they are in `truth`")
        return true_poses(self.truth, self.timestamps_ns)

    @cached_property
    def views(self) -> "FrameViews":
        """What the left camera sees in each frame, by which motion and boxes are computed."""
        from sim.truth.views import FrameViews  # loads MuJoCo

        rig = true_rig(self._root, self.about) if self.about else self.rig
        place = self._root, self.about, self._readers
        return FrameViews(*place, rig, self.timestamps_ns, self.T_world_cam)

    @cached_property
    def imu(self) -> ImuLog:
        """Readings of the inertial unit."""
        readings = read_imu(self.path)
        if readings is None:
            raise DatasetError(f"{self.path}: has no readings of an inertial unit")
        return readings

    @property
    def wheels(self) -> WheelLog:
        """Readings of the wheel encoders."""
        if self.sequence.wheels is None:
            raise DatasetError(f"{self.path}: has no readings of wheel encoders")
        return self.sequence.wheels

    @property
    def things(self) -> dict[int, str]:
        """Number in `segmentation` to the name of the object."""
        return {x["id"]: x["name"] for x in self.about.get("things", ())}

    def table(self) -> "pd.DataFrame":
        """Return times, true poses and wheel ticks, a row a frame, as a pandas.DataFrame.

        Positions are in metres in the world, quaternions that of the left camera; a column exists
        if the recording has it.

        Example:
            >>> list(ds.table())[:4]
            ['timestamp_ns', 'x_m', 'y_m', 'z_m']
        """
        columns: dict[str, Any] = {"timestamp_ns": self.timestamps_ns}
        if self.has_poses:
            columns |= pose_columns(self.T_world_cam)
        if self.sequence.wheels is not None:
            ticks = [self.sequence.wheels.at(int(t)) or (None, None) for t in self.timestamps_ns]
            columns |= {
                f"{side}_ticks": [x[k] for x in ticks] for k, side in enumerate(("left", "right"))
            }
        return data_frame(columns)

    def to_torch(self, items: Collection[str] | None = None, **options: Any) -> Any:
        """Return the frames as a data set of PyTorch, a `driftyard.torch.StereoDataset`.

        Args:
            items: Contents of a sample; left, right, disparity and calibration by default.
            options: `channels`, `as_float` and `transform`.

        Raises:
            DriftyardError: If PyTorch is not installed, or the recording lacks an item.
        """
        chosen = {} if items is None else {"items": items}
        return import_module("driftyard.torch").StereoDataset(self, **chosen, **options)

    @property
    def has_poses(self) -> bool:
        """Whether the recording has true poses, with attitude."""
        try:
            return self.truth.point_cam is None
        except DatasetError:
            return False

    @property
    def _kind_of_truth(self) -> str:
        try:
            return "poses" if self.has_poses else "no poses"
        except DriftyardError:
            return "unreadable"

    @property
    def _facts(self) -> list[tuple[str, str]]:
        rig, times = self.rig, self.timestamps_ns
        facts = [
            ("frames", f"{len(self)}"),
            ("duration", f"{(times[-1] - times[0]) / 1e9:.2f} s"),
            ("images", f"{rig.width_px} x {rig.height_px} px"),
            ("focal length", f"{rig.f_px:.1f} px"),
            ("baseline", f"{rig.baseline_m:.3f} m"),
            ("truth", self._kind_of_truth),
            ("labels", ", ".join(self.labels) or "none"),
        ]
        if self.about:
            facts.append(("scene", f"{self.about['scene']['name']}, seed {self.about['seed']}"))
        return facts

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the place alone, for the processes of a data loader."""
        return _reopen, (self.path.absolute(), self.selection)

    def __repr__(self) -> str:
        return text_display(f"Dataset {self.path}", self._facts)

    def _repr_html_(self) -> str:
        try:
            images = thumbnails(self[0])
        except ImageError:
            images = ""
        return html_display(f"Dataset {self.name}", self._facts, images)


@in_one_family
def open(
    path: PathLike,
    *,
    first: int = 0,
    last: int | None = None,
    every: int = 1,
    skip_missing: bool = False,
    pair_tolerance_ms: float | None = None,
) -> Dataset:
    """Open a recording: of driftyard, EuRoC/ASL, TUM-VI, KITTI odometry or raw, TartanAir, or ROS.

    Args:
        path: Folder of the recording, or bag of ROS: `run.bag`, `run.mcap`, `run.db3`, or its
            folder. Its topics are found by type and name, or chosen by the end of the path:
            `run.bag@left=/cam0/image_raw,right=/cam1/image_raw`, with left_info, right_info, imu,
            wheels and truth likewise.
        first: Index of the first frame that is used, from 0.
        last: Index of the last; by default the last of all.
        every: Use each k-th frame only.
        skip_missing: Leave out frames whose images are missing, which are an error otherwise.
        pair_tolerance_ms: Largest difference of the times of left and right; by default 3 ms or
            a quarter of the frame period.

    Raises:
        DatasetError: If the folder is missing or of an unknown layout, or its content is invalid.
        CalibrationError: If the calibration is missing, malformed or of no stereo pair.
        SettingsError: If no frames are selected.

    Example:
        >>> len(dy.open("ds", every=2)) == (len(dy.open("ds")) + 1) // 2
        True
    """
    selection = FrameSelection(first, last, every, skip_missing, pair_tolerance_ms)
    return _reopen(Path(path), selection)


def _reopen(folder: Path, selection: FrameSelection) -> Dataset:
    return Dataset(folder, open_sequence(folder, selection), selection)


def dataset_of(dataset: Dataset | PathLike) -> Dataset:
    """Return a dataset, opened if it is a path."""
    return dataset if isinstance(dataset, Dataset) else open(dataset)
