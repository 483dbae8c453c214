"""Pictures and pages of runs."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from driftyard.dataset import Dataset, PathLike, dataset_of
from driftyard.estimation import run_of
from driftyard.failures import in_one_family
from trials.evaluation.runs import SavedRun
from trials.report.figure import make_figure
from trials.report.page import aligned_positions, with_distinct_names, write_report
from trials.report.trajectory_plot import SceneMap, read_scene_map, trajectory_drawing
from vo.contract.files import known_suffix, replacing

FORMATS = (".png", ".svg", ".pdf")

Runs = SavedRun | PathLike | Sequence[SavedRun | PathLike]
"""One run or several, or their trajectory files."""


@dataclass(frozen=True, repr=False)
class Plot:
    """A picture, which a notebook shows without a display.

    Attributes:
        figure: The figure of matplotlib, which may be changed before it is shown or saved.

    Example:
        >>> plot = dy.plot(ds, run)
        >>> plot.figure.axes[0].set_title("seed 3")
        Text(...)
        >>> plot.save("path.png").name
        'path.png'
    """

    figure: Figure

    @in_one_family
    def save(self, path: PathLike) -> Path:
        """Write the picture as PNG, SVG or PDF, by the suffix of the name; return the path.

        Raises:
            SettingsError: If the suffix is another one.
            DatasetError: If the file cannot be written.
        """
        out = Path(path)
        known_suffix(out, FORMATS)
        with replacing(out) as partial:
            self.figure.savefig(partial)
        return out

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.figure.savefig(stream, format="png")
        return stream.getvalue()


@in_one_family
def plot(dataset: Dataset | PathLike, runs: Runs = ()) -> Plot:
    """Draw the true path from above, and those of runs, aligned to it by their first poses.

    The background is the map of the scene, where the recording has one. A truth of positions only
    is aligned with by all positions.

    Raises:
        DatasetError: If the recording has no ground truth.
        TrajectoryError: If a run cannot be read, or shares fewer than two times with the truth.

    Example:
        >>> legend = dy.plot(ds, [run, "corner_flow.txt"]).figure.legends[0]
        >>> [text.get_text() for text in legend.get_texts()]
        ['truth', 'corner_flow (1)', 'corner_flow (2)']
    """
    opened = dataset_of(dataset)
    chosen = with_distinct_names([run_of(x, opened) for x in several(runs)])
    truth, background = opened.truth, read_scene_map(opened.path)
    _, _, positions = aligned_positions(truth, chosen)
    has_z_up = truth.point_cam is not None
    draw, size_in = trajectory_drawing(truth.T_ref_frame, has_z_up, positions, background)
    figure = make_figure(size_in, draw)
    panel = figure.axes[0]
    if background is not None:
        _draw_map(figure, background)
    labels = ["truth", *positions]
    paths = [panel.lines[0], *reversed(panel.lines[1 : len(labels)])]
    figure.legend(paths, labels, loc="upper right")
    return Plot(figure)


@in_one_family
def report(dataset: Dataset | PathLike, runs: Runs, out: PathLike = "report.html") -> Path:
    """Write runs as one self-contained HTML page, the first in detail; return its path.

    Raises:
        DatasetError: If the recording has no ground truth, or the page cannot be written.
        TrajectoryError: If a run cannot be read, or shares fewer than two times with the truth.

    Example:
        >>> dy.report(ds, [run], "report.html").stat().st_size > 10_000
        True
    """
    folder = dataset.path if isinstance(dataset, Dataset) else Path(dataset)
    write_report(folder, [run_of(x, dataset) for x in several(runs)], Path(out))
    return Path(out)


def several(runs: Runs) -> Sequence[SavedRun | PathLike]:
    """Return runs as a sequence."""
    return runs if isinstance(runs, Sequence) and not isinstance(runs, str) else (runs,)


def _draw_map(figure: Figure, background: SceneMap) -> None:
    """Draw the map beneath the paths."""
    (x_min, y_min), (x_max, y_max) = background.limits_m
    rgb = cv2.cvtColor(np.asarray(background.image), cv2.COLOR_BGR2RGB)
    panel = figure.axes[0]
    panel.imshow(rgb, extent=(x_min, x_max, y_min, y_max), zorder=0, aspect="auto")
