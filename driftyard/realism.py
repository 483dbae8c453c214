"""How far simulation is from real recordings: comparison, matched cameras, real disturbances."""

from pathlib import Path

from driftyard.dataset import Dataset, PathLike
from driftyard.failures import in_one_family
from trials.realism.comparison import FRAMES, Comparison, Progress, compare_recordings
from trials.realism.page import write_page


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


def _folder(dataset: Dataset | PathLike) -> Path:
    return dataset.path if isinstance(dataset, Dataset) else Path(dataset)
