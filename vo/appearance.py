"""What is wrong with a picture, in words: dark, blank, blurred, blocked, or the eyes swapped."""

from vo.config import OdometrySettings
from vo.contract.arrays import Image
from vo.contract.sequence import StereoFrame
from vo.disparity import measure_disparities
from vo.stereo import DenseStereo
from vo.view import View

DARK_GREY = 6.0
"""Mean grey level below which nothing is to be seen."""

BLANK_GREY = 2.0
"""Standard deviation of the grey levels of a picture without anything in it."""

FEW_FEATURES = 60
PROBES = 80
"""Features on which the eyes are tried the other way round."""

SWAPPED = 3.0
"""So many times more of them must have a disparity then."""


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
