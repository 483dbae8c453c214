"""Formats by name, and the export of datasets."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.progress import Progress
from trials.formats.colmap import write_colmap
from trials.formats.disparity import write_kitti_stereo, write_middlebury, write_sceneflow
from trials.formats.folder import Advance, new_folder
from trials.formats.huggingface import write_huggingface
from trials.formats.kitti import write_kitti
from trials.formats.mcap import write_mcap
from trials.formats.recording import Recording, open_recording
from trials.formats.tartanair import write_tartanair
from trials.formats.tum import write_tum_rgbd
from trials.formats.webdataset import write_webdataset
from vo.contract.errors import SettingsError
from vo.recordings.pairing import ALL_FRAMES, FrameSelection

Writer = Callable[[Sequence[Recording], Path, Advance], None]
"""Writes recordings into a folder; advances once for each frame."""


@dataclass(frozen=True)
class Format:
    """A format: what it is, in a few words, its writer, and whether it is nothing without poses."""

    summary: str
    write: Writer
    needs_poses: bool = False


def _each(write: Callable[[Recording, Path, Advance], None]) -> Writer:
    """Make a writer that gives each of several recordings a folder of its name."""

    def write_all(recordings: Sequence[Recording], out: Path, advance: Advance) -> None:
        for recording in recordings:
            write(recording, out / recording.name if len(recordings) > 1 else out, advance)

    return write_all


FORMATS = {
    "kitti": Format("KITTI odometry", _each(write_kitti), needs_poses=True),
    "tum": Format("TUM RGB-D", _each(write_tum_rgbd), needs_poses=True),
    "kitti_stereo": Format("KITTI stereo 2015", _each(write_kitti_stereo)),
    "middlebury": Format("Middlebury stereo, PFM", _each(write_middlebury)),
    "sceneflow": Format("SceneFlow, PFM", _each(write_sceneflow)),
    "tartanair": Format("TartanAir V2", _each(write_tartanair), needs_poses=True),
    "colmap": Format("COLMAP, text", _each(write_colmap), needs_poses=True),
    "mcap": Format("MCAP with ROS 2 messages", write_mcap),
    "webdataset": Format("WebDataset shards", _each(write_webdataset)),
    "huggingface": Format("Hugging Face dataset", write_huggingface),
}
"""Every format by the name that `export` takes."""


def find_format(name: str) -> Format:
    """Return a format by its name.

    Raises:
        SettingsError: If there is none of that name; lists those that exist.
    """
    if name not in FORMATS:
        raise SettingsError(f"no format {name!r}; the formats are {', '.join(FORMATS)}")
    return FORMATS[name]


def export(
    datasets: Sequence[Path],
    name: str,
    out: Path,
    frames: FrameSelection = ALL_FRAMES,
    progress: Progress = lambda done, total: None,
) -> int:
    """Write datasets or recordings in a format of FORMATS; returns the number of frames.

    Of several, each has a folder of its name in `out`, or its name in the files' names.

    Args:
        datasets: Folders of any layout that `open_sequence` reads, at least one.
        name: Of the format.
        out: Folder that must not exist; it appears when all is written.
        frames: Frames of each dataset.
        progress: Called with the frames done and in total.

    Raises:
        SettingsError: If the format is unknown, or two datasets have one name.
        DatasetError: If a dataset is unreadable or lacks what the format needs; if `out` exists or
            cannot be written.
        DriftyardError: As `open_recording`.
    """
    form = find_format(name)
    if not datasets:
        raise SettingsError("export: no dataset is named")
    with new_folder(out) as partial:
        recordings = [open_recording(folder, frames, form.needs_poses) for folder in datasets]
        names = [x.name for x in recordings]
        if twice := next((x for x in names if names.count(x) > 1), ""):
            raise SettingsError(f"{twice}: two datasets have this name; export them one by one")
        total, done = sum(map(len, recordings)), 0

        def advance(_: object) -> None:
            nonlocal done
            done += 1
            progress(done, total)

        form.write(recordings, partial, advance)
    return total
