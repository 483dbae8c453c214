"""Reasons, in words, why a frame has no pose or a weak one: images, calibration, inliers."""

from collections.abc import Collection
from dataclasses import dataclass
from statistics import median

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Image
from vo.contract.observations import Observations
from vo.contract.sequence import StereoFrame
from vo.map.frame import View
from vo.stereo.dense import DenseStereo
from vo.stereo.right_pixels import expect_right, find_right
from vo.stereo.sparse import measure_disparities


@dataclass(frozen=True)
class DiagnosticThresholds:
    """Limits beyond which an image or a calibration is reported (decision 25)."""

    dark_grey: float = 6.0
    """Mean grey level of a dark image."""
    blank_grey: float = 2.0
    """Standard deviation of the grey levels of a blank image."""
    faint_grey: float = 4.0
    """Standard deviation of the grey levels of an image whose texture is mostly rounding."""
    few_features: int = 60
    probes: int = 80
    """Features on which the exchanged pair is tried, or the rows are compared."""
    swapped_ratio: float = 3.0
    """Ratio of features with a disparity, exchanged to given, of swapped images."""
    min_offset_landmarks: int = 20
    """Landmarks that a vertical offset needs."""
    offset_keyframes: int = 10
    """Keyframes over which a vertical offset must persist."""
    offset_px: float = 0.25
    """Vertical offset that is reported (decision 21)."""


LIMITS = DiagnosticThresholds()


def explain_failure(view: View, frame: StereoFrame) -> str:
    """Say what is wrong with the images of a frame, as they were taken; empty if nothing is."""
    images = {"left": frame.left, "right": frame.right}
    flaws = [f"{name} image {flaw}" for name, image in images.items() if (flaw := _flaw(image))]
    if flaws:
        return ", ".join(flaws)
    if len(view.features) < LIMITS.few_features:
        return f"{len(view.features)} features: blurred or without texture"
    return "left and right images look swapped" if images_look_swapped(view) else ""


def _flaw(image: Image) -> str:
    mean, deviation = float(image.mean()), float(image.std())
    if mean < LIMITS.dark_grey:
        return f"dark (mean grey {mean:.1f})"
    if deviation < LIMITS.blank_grey:
        return f"blank (grey {mean:.0f} throughout)"
    return ""


def is_faint(image: Image) -> bool:
    """Whether the texture of an image is mostly rounding, as before the exposure adapts."""
    _, deviation = cv2.meanStdDev(image)
    return float(deviation[0, 0]) < LIMITS.faint_grey


def images_look_swapped(view: View) -> bool:
    """Whether far more features have a disparity with the images exchanged."""
    pixels = view.features[: LIMITS.probes]
    frame, settings = view.frame, view.settings.stereo
    swapped = StereoFrame(frame.timestamp_ns, frame.right, frame.left)

    def known(pair: StereoFrame) -> int:
        dense = DenseStereo(settings)(pair.left, pair.right)
        return int(measure_disparities(pair, dense, pixels, settings).known.sum())

    more = known(swapped) > LIMITS.swapped_ratio * max(known(frame), 1)
    return more and known(swapped) > LIMITS.probes // 8


def add_row_offset(
    offsets_px: tuple[float, ...], view: View, seen: Observations
) -> tuple[float, ...]:
    """Add the vertical offset of the right image to the left one to those of the last keyframes.

    In pixels, positive downwards: the median over landmarks, aligned in both directions. It is zero
    if the pair is rectified as its calibration says. With few landmarks nothing is added.
    """
    known = seen.measured[~np.isnan(seen.disparity_px)][: LIMITS.probes]
    pixels, side = known[:, :2], view.settings.stereo.align_px
    start = expect_right(view.frame, pixels, known[:, 2])
    lower = (find_right(view.frame, pixels, start, side) - start)[:, 1]
    lower = lower[~np.isnan(lower)]
    if len(lower) < LIMITS.min_offset_landmarks:
        return offsets_px
    return (*offsets_px, float(np.median(lower)))[-LIMITS.offset_keyframes :]


def explain_calibration(offsets_px: Collection[float]) -> str:
    """Report a vertical offset that persists over keyframes; empty if there is none."""
    if len(offsets_px) < LIMITS.offset_keyframes or abs(median(offsets_px)) < LIMITS.offset_px:
        return ""
    return f"right rows lie {median(offsets_px):+.2f} px lower: is the stereo calibration right?"


def explain_weakness(inliers: int, iterations: int, settings: OdometrySettings) -> str:
    """Say why a pose is weak: few inliers, or many iterations; empty if it is not."""
    if inliers < settings.motion.weak_inliers:
        return f"{inliers} inliers, fewer than {settings.motion.weak_inliers}"
    if exceeds_iterations(iterations, settings):
        return f"{iterations} iterations, more than {settings.refinement.max_keyframe_iterations}"
    return ""


def exceeds_iterations(iterations: int, settings: OdometrySettings) -> bool:
    """Whether a pose took too many iterations for a keyframe (thesis 5.3); off by default."""
    return 0 < settings.refinement.max_keyframe_iterations < iterations
