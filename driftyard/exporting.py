"""Exports of recordings in the formats of other tools."""

from collections.abc import Sequence
from pathlib import Path

from driftyard.dataset import Dataset, PathLike
from driftyard.failures import in_one_family
from trials.formats.registry import export as write
from vo.contract.errors import SettingsError
from vo.recordings.pairing import ALL_FRAMES


@in_one_family
def export(
    datasets: Dataset | PathLike | Sequence[Dataset | PathLike], to: str, out: PathLike
) -> Path:
    """Write recordings in the format of another tool; `docs/formats.md` describes each.

    Of several, each has a folder of its name in `out`, or its name in the files' names.

    Args:
        datasets: One or several open recordings, of which the chosen frames are written, or
            their folders.
        to: Format: kitti, tum, kitti_stereo, middlebury, sceneflow, tartanair, colmap, mcap,
            webdataset or huggingface.
        out: Folder, which must not exist; it appears when all is written.

    Returns:
        The folder.

    Raises:
        SettingsError: If the format is unknown, two recordings have one name, or the chosen
            frames of several differ.
        DatasetError: If a recording lacks what the format needs, or `out` cannot be written.

    Example:
        >>> out = dy.export(ds, "kitti", "ds_kitti")
        >>> len(dy.open(out)) == len(ds)
        True
    """
    several = isinstance(datasets, Sequence) and not isinstance(datasets, str)
    many = datasets if several else [datasets]
    choices = [x.selection if isinstance(x, Dataset) else ALL_FRAMES for x in many]
    if any(x != choices[0] for x in choices):
        raise SettingsError("export: the chosen frames differ; export the recordings one by one")
    folders = [x.path if isinstance(x, Dataset) else Path(x) for x in many]
    write(folders, to, Path(out), choices[0] if choices else ALL_FRAMES)
    return Path(out)
