"""Views of recordings and runs in Rerun's viewer."""

from collections.abc import Callable

from driftyard.dataset import Dataset, PathLike, dataset_of
from driftyard.estimation import run_of
from driftyard.failures import in_one_family
from driftyard.figures import Runs, several
from trials.view.target import target_of


@in_one_family
def view(
    dataset: Dataset | PathLike,
    runs: Runs = (),
    to: PathLike | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Show a recording and runs in Rerun's viewer (`pip install "driftyard[view]"`).

    There are the scene, or else depth or the map; cameras at true and estimated poses; both images
    with features, matches and tracks; depth; paths, aligned as by `score`; ellipsoids of the
    covariance; errors, status and reason of each frame; and readings of other sensors.
    `docs/view.md` describes them.

    Args:
        dataset: An open recording, of which the chosen frames are shown, or its folder.
        runs: One run or several, or their trajectory files.
        to: A file that ends in .rrd, or the address of a viewer as
            `rerun+http://127.0.0.1:9876/proxy`; by default a window.
        progress: Called with the number of frames done and that of all frames.

    Raises:
        SettingsError: If the package is missing, there is no display for a window, or nothing
            listens at the address.
        DatasetError: If the recording is invalid, or the file cannot be written.
        TrajectoryError: If a run cannot be read.

    Example:
        >>> dy.view(ds, run, "ds.rrd")  # doctest: +SKIP
    """
    target, opened = target_of(to), dataset_of(dataset)
    chosen = [run_of(x, opened) for x in several(runs)]
    from trials.view.show import show  # loads the simulator

    show(opened.path, opened.selection, chosen, target, progress)
