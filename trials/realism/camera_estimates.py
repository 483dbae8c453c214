"""Estimates of a camera's settings from the statistics of a recording, each with an interval."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from sim.imaging.image_sensor import WELL
from sim.imaging.linear_light import Curve, Response, levels_to_light
from trials.realism.comparison import block_draws
from trials.realism.noise import ROUNDING
from trials.realism.quantities import NOISE_GREY, QUANTITIES, SHIFT_R2, Measured
from trials.realism.sharpness import MIN_EDGES
from vo.contract.arrays import Array, Indices

CONFIDENCE = 0.95
MIN_VARIANCE = 0.15
"""Variance, grey levels squared and without rounding, below which 8 bits hide the noise."""
MIN_BINS = 3
NOISE_ERROR = 0.03
"""Relative error of the noise by texture that is left in flat blocks."""
RENDERED_PX, RENDERED_ERROR_PX = 0.44, 0.04
"""Width of the edges of a perfect simulated camera, and its range over scenes."""
WIDTH_ERROR = 0.04
"""Relative error of the width of edges by what is near them."""
LIGHT_ERROR = 0.0006
"""Error of the logarithm of the light of a point, from one eye to the other."""
WIDTHS = 400
"""Number of quantiles of the widths of edges from which the most frequent one is found."""


@dataclass(frozen=True)
class CameraSetting:
    """Estimate of a setting.

    Attributes:
        key: Of `driftyard settings recording`.
        value: The estimate; None if there is none.
        low: Lower end of its 95 % interval; NaN for what is known exactly, or chosen.
        high: Upper end.
        note: How it was found, or why it was not.

    Example:
        >>> dy.CameraSetting("sensor.read_noise", 12.04, 11.2, 12.9, "").text
        '12.04 (11.2 to 12.9)'
    """

    key: str
    value: float | str | bool | None
    low: float = np.nan
    high: float = np.nan
    note: str = ""

    @property
    def text(self) -> str:
        """Value and interval."""
        if self.value is None or isinstance(self.value, str | bool):
            return "–" if self.value is None else str(self.value).lower()
        interval = f" ({self.low:.4g} to {self.high:.4g})" if math.isfinite(self.low) else ""
        return f"{self.value:.4g}{interval}"


def estimate_response(measured: Measured) -> Response:
    """Return the response under which shot and read noise explain the noise better."""
    errors = {x: _noise_misfit(measured, x) for x in ("srgb", "linear")}
    return "linear" if errors["linear"] < errors["srgb"] else "srgb"


def estimate_noise(measured: Measured, response: Response) -> list[CameraSetting]:
    """Estimate full well and read noise, electrons without gain."""
    keys = "sensor.full_well", "sensor.read_noise"
    grey, variance, counts = _noise_curves(measured, np.ones((1, measured.frames)))
    if np.isfinite(variance).sum() < MIN_BINS:
        return [CameraSetting(key, None, note=QUANTITIES["noise"].missing) for key in keys]
    if np.nanmedian(variance) < MIN_VARIANCE:
        hidden = "the noise is below what 8 bits resolve"
        return [CameraSetting(key, 0.0, note=hidden) for key in keys]
    fits = [_electrons(grey[0], variance[0], counts[0], response)]
    draws = block_draws(measured.frames, np.random.default_rng(0))
    curves = zip(*_noise_curves(measured, draws), strict=True)
    fits += [_electrons(*x, response) for x in curves if np.isfinite(x[1]).sum() >= MIN_BINS]
    found: list[CameraSetting] = []
    for key, value, several in zip(keys, fits[0], np.array(fits[1:]).T, strict=True):
        low, high = np.quantile(several, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
        low, high = float(low * (1 - NOISE_ERROR)), float(high * (1 + NOISE_ERROR))
        note = "from the noise at each grey level"
        found.append(CameraSetting(key, float(value), low, high, note))
    return found


def estimate_softness(measured: Measured) -> CameraSetting:
    """Estimate the lens's point spread function, standard deviation in px."""
    key, statistic = "sensor.softness_px", measured.statistics["edge_width"]
    if statistic.parts.sum() < MIN_EDGES:
        return CameraSetting(key, None, note=QUANTITIES["edge_width"].missing)
    width = _frequent_widths(statistic.parts.sum(axis=0)[None])[0]
    draws = block_draws(measured.frames, np.random.default_rng(0))
    spread = 2 * np.nanstd(_frequent_widths(draws @ statistic.parts))
    margin = math.hypot(float(spread), WIDTH_ERROR * width)

    def softness(width_px: float, rendered_px: float) -> float:
        return math.sqrt(max(width_px**2 - rendered_px**2, 0.0))

    low = softness(width - margin, RENDERED_PX + RENDERED_ERROR_PX)
    high = softness(width + margin, RENDERED_PX - RENDERED_ERROR_PX)
    note = f"edges are {width:.2f} px wide, those of a perfect simulated camera {RENDERED_PX:g}"
    return CameraSetting(key, softness(width, RENDERED_PX), low, high, note)


def estimate_light(measured: Measured) -> list[CameraSetting]:
    """Estimate the vignetting, and the sensitivity of the right camera over that of the left."""
    found: list[CameraSetting] = []
    for name in ("vignetting", "right_gain"):
        key, estimate = f"sensor.{name}", measured.estimate(name)
        if estimate is None:
            found.append(CameraSetting(key, None, note=QUANTITIES[name].missing))
            continue
        draws = block_draws(measured.frames, np.random.default_rng(0))
        spread = float(2 * np.nanstd(measured.statistics[name].pooled(draws)))
        value, error = float(estimate[0]), LIGHT_ERROR
        if name == "vignetting":
            shift = measured.statistics[SHIFT_R2].pooled(np.ones((1, measured.frames)))[0, 0]
            error = 2 * LIGHT_ERROR / max(float(shift), 1e-6)
        margin = math.hypot(spread, error)
        limits = value - margin, value + margin
        note = "from points that both eyes see"
        if name == "vignetting" and value <= 0:
            value, note = 0.0, f"{note}: the corner is not darker"
        found.append(CameraSetting(key, value, *limits, note))
    return found


def estimate_drops(timestamps_ns: Indices) -> CameraSetting:
    """Estimate the share of lost frames from gaps between times (N,)."""
    steps = np.diff(timestamps_ns)
    if not len(steps):
        return CameraSetting("sensor.drop_share", None, note="a single frame")
    lost = float((np.round(steps / np.median(steps)) - 1).clip(0).sum())
    share = min(lost / (lost + len(timestamps_ns)), 0.9)
    return CameraSetting("sensor.drop_share", share, note="from gaps between times of frames")


def _noise_curves(measured: Measured, counts: Array) -> tuple[Array, Array, Array]:
    """Return mean grey level, variance without rounding, and number of blocks, (R, G) each."""
    noise, grey = measured.statistics["noise"], measured.statistics[NOISE_GREY]
    assert noise.weights is not None
    return grey.pooled(counts), noise.pooled(counts) - ROUNDING, counts @ noise.weights


def noise_parts(measured: Measured, curve: Response | Curve) -> Array | None:
    """Return shot and read noise, as variances of light by light and alone, (2,).

    None with too few grey levels.
    """
    grey, variance, counts = _noise_curves(measured, np.ones((1, measured.frames)))
    if (np.isfinite(variance) & (variance > 0)).sum() < MIN_BINS:
        return None
    return _fit(grey[0], variance[0], counts[0], curve)[0]


def _fit(
    grey: Array, variance: Array, counts: Array, curve: Response | Curve
) -> tuple[Array, float]:
    """Fit shot and read noise, as variances of light by light and alone, (2,); mean misfit.

    Bins count by the relative error of their variance.
    """
    known = np.isfinite(variance) & (variance > 0)
    level = grey[known]
    light = np.maximum(levels_to_light(curve, level), 0)
    slope = levels_to_light(curve, level + 0.5) - levels_to_light(curve, level - 0.5)
    of_light = variance[known] * slope**2
    weight = np.sqrt(counts[known] / counts[known].sum()) / of_light
    columns = np.stack([light, np.ones(len(light))], axis=1) * weight[:, None]
    scale = np.linalg.norm(columns, axis=0)
    parts, misfit = nnls(columns / scale, of_light * weight)
    return parts / scale, float(misfit)


def _noise_misfit(measured: Measured, response: Response) -> float:
    curve = _noise_curves(measured, np.ones((1, measured.frames)))
    grey, variance, counts = (x[0] for x in curve)
    if (np.isfinite(variance) & (variance > 0)).sum() < MIN_BINS:
        return 0.0
    return _fit(grey, variance, counts, response)[1]


def _electrons(
    grey: Array, variance: Array, counts: Array, response: Response
) -> tuple[float, float]:
    """Return full well and read noise; a full well of 0 without shot noise."""
    return electrons(_fit(grey, variance, counts, response)[0])


def electrons(parts: Array) -> tuple[float, float]:
    """Return full well and read noise of noise parts (2,); a full well of 0 without shot noise."""
    shot, floor = parts
    if shot <= 0:
        return 0.0, math.sqrt(floor) * WELL
    return 1 / shot, math.sqrt(floor) / shot


def frequent_width(measured: Measured) -> float:
    """Return the most frequent width of edges, px; NaN with too few."""
    statistic = measured.statistics["edge_width"]
    if statistic.parts.sum() < MIN_EDGES:
        return np.nan
    return float(_frequent_widths(statistic.parts.sum(axis=0)[None])[0])


def _frequent_widths(counts: Array) -> Array:
    """Return the most frequent width (R,) of histograms of edge widths (R, B), as `edge_width`."""
    x = QUANTITIES["edge_width"].x
    edges = np.r_[x - (x[1] - x[0]) / 2, x[-1] + (x[1] - x[0]) / 2]
    shares = np.linspace(0, 1, WIDTHS + 1)
    found = np.full(len(counts), np.nan)
    for k, row in enumerate(counts):
        if row.sum() > 0:
            quantiles = np.interp(shares, np.r_[0, np.cumsum(row)] / row.sum(), edges)
            half = WIDTHS // 2
            at = int(np.argmin(quantiles[half:] - quantiles[: half + 1]))
            found[k] = (quantiles[at] + quantiles[at + half]) / 2
    return found
