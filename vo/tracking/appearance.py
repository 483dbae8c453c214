"""What is wrong with the pictures, in words: dark, blank, blurred, swapped or askew."""

from collections.abc import Collection
from statistics import median

import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Array, Image
from vo.contract.sequence import StereoFrame
from vo.map.frame import View
from vo.patches.alignment import align
from vo.patches.templates import extract_templates
from vo.stereo.dense import DenseStereo
from vo.stereo.sparse import measure_disparities

DARK_GREY = 6.0
"""Mean grey level below which nothing is to be seen."""

BLANK_GREY = 2.0
"""Standard deviation of the grey levels of a picture without anything in it."""

FEW_FEATURES = 60
PROBES = 80
"""Features on which the eyes are tried the other way round."""

SWAPPED = 3.0
"""So many times more of them must have a disparity then."""


FEWEST_ROWS = 20
"""Landmarks whose median tells where rows lie."""

PERSISTENT = 10
"""Keyframes before rows that do not meet are put down to the calibration."""

ASKEW_PX = 0.25


def explain_failure(view: View, settings: OdometrySettings) -> str:
    """Say why a view may be useless; empty if nothing is wrong with it by itself."""
    eyes = {"left": view.frame.left, "right": view.frame.right}
    flaws = [f"{name} image {flaw}" for name, image in eyes.items() if (flaw := _flaw(image))]
    if flaws:
        return ", ".join(flaws)
    if len(view.features) < FEW_FEATURES:
        return f"{len(view.features)} features: blurred or without texture"
    return "the eyes look swapped" if eyes_look_swapped(view, settings) else ""


def _flaw(image: Image) -> str:
    mean, deviation = float(image.mean()), float(image.std())
    if mean < DARK_GREY:
        return f"dark (mean grey {mean:.1f})"
    if deviation < BLANK_GREY:
        return f"blank (grey {mean:.0f} throughout)"
    return ""


def eyes_look_swapped(view: View, settings: OdometrySettings) -> bool:
    """Whether far more features have a disparity with the eyes the other way round."""
    pixels = view.features.pixels[:PROBES]
    frame = view.frame
    swapped = StereoFrame(frame.timestamp_ns, frame.right, frame.left)

    def known(pair: StereoFrame) -> int:
        dense = DenseStereo(settings.stereo)(pair.left, pair.right)
        return int(measure_disparities(pair, dense, pixels, settings.stereo).known.sum())

    return known(swapped) > SWAPPED * max(known(frame), 1) and known(swapped) > PROBES // 8


def row_offset_px(view: View, measured: Array, settings: OdometrySettings) -> float:
    """How much lower the right image shows what the left one does, pixels; NaN if unknown.

    Zero, if the pair is rectified as its calibration says. Median over landmarks, aligned in both
    directions.

    Args:
        view: The pair.
        measured: (N, 3) left-image u, v and disparity of landmarks, NaN where unknown.
        settings: Of the patches.
    """
    known = measured[~np.isnan(measured[:, 2])][:PROBES]
    start = known[:, :2] - np.column_stack([known[:, 2], np.zeros(len(known))])
    templates = extract_templates(view.frame.left, known[:, :2], settings.stereo.align_px)
    lower = align(templates, view.frame.right, start).pixels[:, 1] - known[:, 1]
    lower = lower[~np.isnan(lower)]
    return float(np.median(lower)) if len(lower) >= FEWEST_ROWS else np.nan


def explain_calibration(offsets_px: Collection[float]) -> str:
    """Complain of rows that persistently do not meet, by the offsets of PERSISTENT keyframes."""
    if len(offsets_px) < PERSISTENT or abs(median(offsets_px)) < ASKEW_PX:
        return ""
    return f"right rows lie {median(offsets_px):+.2f} px lower: is the stereo calibration right?"
