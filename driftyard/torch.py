"""Recordings as data sets of PyTorch, which is imported with this module."""

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any

from driftyard.failures import in_one_family
from driftyard.samples import DEFAULT_ITEMS, Datasets, Samples, samples_of
from vo.contract.errors import DriftyardError

if TYPE_CHECKING:
    from torch.utils.data import Dataset as MapDataset

    _Base = MapDataset[Any]
else:
    try:
        from torch.utils.data import Dataset as _Base
    except ImportError:
        _Base = object  # instances say what is missing


class StereoDataset(_Base):
    """Samples of recordings, a dictionary of tensors for each frame, for `DataLoader`.

    Images and labels are (C, H, W). Labels with unknown pixels hold 0 there, and NAME_valid is the
    mask (1, H, W), bool. A sample of which an item needs the next frame, such as flow, exists for
    each frame that is followed by the next one of its recording. Files are opened when a sample is
    read, in whichever process; pickles hold the paths of the recordings alone.

    Items:
        left, right: Images, float32 from 0 to 1, or uint8; left_next and right_next those of the
            next frame.
        disparity, disparity_right, depth: (1, H, W) float32, px or metres, with a mask.
        flow: (2, H, W) float32, px to the next frame, with a mask.
        normals: (3, H, W) float32 in camera axes, with a mask.
        occlusion, covisibility, segmentation, classes: (1, H, W) int64 codes, as `Dataset` has
            them.
        T_world_cam, T_cam_next: (4, 4) float32 true pose of the left camera in the world, and of
            the next frame's camera in this one's; frames without are left out.
        K, baseline_m: (3, 3) and () float32 delivered calibration of the rectified pair.
        timestamp_ns, sequence: () int64 time of the frame, and number of the recording.

    Attributes:
        samples: The same as arrays of NumPy.
        transform: Called with each sample; its result is returned.

    Example:
        >>> train = dy.torch.StereoDataset(["a", "b"], items=("left", "right", "disparity"))
        >>> loader = torch.utils.data.DataLoader(train, batch_size=4, shuffle=True, num_workers=2)
        >>> batch = next(iter(loader))
        >>> batch["left"].shape, batch["disparity_valid"].dtype
        (torch.Size([4, 1, 120, 160]), torch.bool)
    """

    @in_one_family
    def __init__(
        self,
        datasets: Datasets,
        items: Collection[str] = DEFAULT_ITEMS,
        *,
        channels: int = 1,
        as_float: bool = True,
        transform: Callable[[dict[str, Any]], Any] | None = None,
    ) -> None:
        """Open recordings.

        Args:
            datasets: One or several open recordings, or their paths, of whatever `open` reads;
                of an open one, the chosen frames.
            items: Contents of a sample.
            channels: Of images: 1, or 3 equal ones, for networks that expect colour.
            as_float: Whether images are float32 from 0 to 1; else uint8.
            transform: Function of a sample, such as a crop to a common size; with workers that are
                spawned, one that can be pickled.

        Raises:
            SettingsError: If an item is unknown.
            DatasetError: If a recording is invalid, or lacks an item.
            DriftyardError: If PyTorch is not installed.
        """
        if _Base is object:
            raise DriftyardError("PyTorch is not installed: pip install 'driftyard[torch]'")
        self.samples: Samples = samples_of(datasets, items, channels, as_float)
        self.transform: Callable[[dict[str, Any]], Any] | None = transform

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> Any:
        """Read a sample.

        Raises:
            FrameIndexError: If there is no such sample; it is an IndexError.
            ImageError: If a file is damaged.
        """
        import torch

        sample = {name: torch.from_numpy(x) for name, x in self.samples[index].items()}
        return self.transform(sample) if self.transform else sample
