"""How far simulation is from real recordings: comparison, matched cameras, real disturbances."""

from pathlib import Path

from driftyard.dataset import Dataset, PathLike
from driftyard.dataset import open as open_dataset
from driftyard.failures import in_one_family
from trials.realism.camera_match import CameraMatch
from trials.realism.comparison import FRAMES, Comparison, Progress, compare_recordings
from trials.realism.degradation import degrade_recording
from trials.realism.match_figure import write_match_figure
from trials.realism.matching import match_camera
from trials.realism.page import write_page
from vo.recordings.pairing import ALL_FRAMES


@in_one_family
def compare(
    real: Dataset | PathLike,
    simulated: Dataset | PathLike,
    out: PathLike | None = None,
    *,
    frames: int = FRAMES,
    progress: Progress | None = None,
) -> Comparison:
    """Compare a simulated recording with a real one, without truth; `docs/compare.md` says how.

    As many frames of each are used as the shorter one has. What cannot be estimated says why.

    Args:
        real: An open recording, or its folder.
        simulated: Likewise.
        out: HTML page to write; none by default.
        frames: Largest number of frames of each recording, from the first.
        progress: Called with the number of frames done and that of all frames.

    Returns:
        Distances by the name of the quantity, each with its sampling error: `distances`,
        `table()`, `to_dict()`; a notebook shows the table.

    Raises:
        DriftyardError: If a recording is unreadable, or the page cannot be written.

    Example:
        >>> found = dy.compare("ds", "ds", frames=4)
        >>> found.distances["noise"].reason[:21]
        'ds and ds: no grey le'
    """
    found = compare_recordings(_folder(real), _folder(simulated), frames, progress)
    if out is not None:
        write_page(found, Path(out))
    return found


@in_one_family
def match(
    real: Dataset | PathLike,
    out: PathLike | None = None,
    *,
    scenes: str = "all",
    frames: int = 100,
    page: PathLike | None = None,
    figure: PathLike | None = None,
    progress: Progress | None = None,
) -> CameraMatch:
    """Estimate the camera of a real recording, and find the scene that is nearest with it.

    Each setting is estimated from the statistics of `compare`, with an interval. The scenes are
    recorded with them, or taken from `build/cache`; the nearest one, the twin, corrects them.
    `docs/compare.md` says how.

    Args:
        real: An open recording, or its folder.
        out: TOML file of settings for `record(camera=)` and `driftyard generate --camera`.
        scenes: Names `a,b` of scenes to try, or all; none if it is empty.
        frames: Largest number of frames of the recording, from the first.
        page: HTML page of the recording beside the nearest scene.
        figure: Image of both, and of the distances to the nearest scene and to the default picture.
        progress: Called with the number of steps done and that of all, for each part in turn.

    Returns:
        `values`, `estimates` with intervals, `scenes`, `unmatched`, `toml()`, `to_dict()`.

    Raises:
        DriftyardError: If the recording is unreadable, a scene is unknown, or a file cannot be
            written.

    Example:
        >>> match = dy.match(ds, scenes="", frames=8)
        >>> match.values["rig.height_px"], match.values["sensor.drop_share"]
        (120, 0.0)
    """
    found = match_camera(_folder(real), Path(out) if out else None, scenes, frames, progress)
    if page is not None and found.comparison is not None:
        write_page(found.comparison, Path(page))
    if figure is not None and found.comparison is not None:
        write_match_figure(found, Path(figure))
    return found


@in_one_family
def degrade(
    real: Dataset | PathLike,
    disturb: str,
    out: PathLike,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Dataset:
    """Apply disturbances of the simulator to a real recording, write it rectified, and open it.

    Truth, inertial readings and encoders are carried over. A warning says so where motion within
    a frame is estimated from the images.

    Args:
        real: An open recording, of which the chosen frames are used, or its folder.
        disturb: Disturbances such as `noise=0.5,drop`: of lens, sensor, shutter and calibration.
        out: Folder to write, which must not exist.
        seed: Random seed of noise and lost frames.
        progress: Called with the number of frames done and that of all frames.

    Raises:
        SettingsError: If a disturbance is unknown, or needs the simulator.
        DatasetError: If the recording is unreadable, or `out` exists or cannot be written.

    Example:
        >>> worse = dy.degrade(ds, "noise=0.5,defocus=0.2", "worse")
        >>> len(worse) == len(ds), worse.has_poses
        (True, True)
    """
    frames = real.selection if isinstance(real, Dataset) else ALL_FRAMES
    degrade_recording(_folder(real), disturb, Path(out), seed, frames, progress)
    return open_dataset(out)


def _folder(dataset: Dataset | PathLike) -> Path:
    return dataset.path if isinstance(dataset, Dataset) else Path(dataset)
