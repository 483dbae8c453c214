"""Picture of the rows in which both cameras see the same points, before and after a correction."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from trials.report.figure import save_figure
from vo.recording_calibration import Calibration

SIZE_IN = (9.0, 3.6)
WIDEST_PX = 1.0
"""Largest end of the scale of colours."""


def save_row_plot(out: Path, calibration: Calibration) -> None:
    """Draw the difference of rows over the left image, one point for each landmark."""
    offsets = calibration.row_offsets_px
    limit_px = float(np.clip(3 * np.nanmedian(np.abs(offsets[0])), 0.1, WIDEST_PX))
    rig, pixels = calibration.rig, calibration.samples.pixels

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        names = "as calibrated", "corrected"
        sigmas = calibration.estimate.row_px
        for panel, name, values, sigma_px in zip(panels, names, offsets, sigmas, strict=True):
            panel.scatter(*pixels.T, c=values, s=6, cmap="coolwarm", vmin=-limit_px, vmax=limit_px)
            panel.set(xlim=(0, rig.width_px), ylim=(rig.height_px, 0), aspect="equal")
            panel.set(title=f"{name}: {sigma_px:.3f} px", xlabel="u, px")
        panels[0].set_ylabel("v, px")
        figure.colorbar(
            panels[1].collections[0], ax=panels, label="row in the right image, less expected, px"
        )

    save_figure(out, SIZE_IN, draw)
