"""Corrections of a camera by the recording of its twin, measured as the real recording is.

What an estimate of the real recording has too much or too little, because of texture, edges or a
wrong response, that of the twin has too: the difference of both corrects the setting.
"""

import math
from collections.abc import Mapping

import numpy as np
from scipy.optimize import minimize

from sim.imaging.linear_light import Curve, levels_to_light, light_to_levels
from trials.realism.camera_estimates import electrons, frequent_width, noise_parts
from trials.realism.comparison import distances
from trials.realism.geometry_estimates import FASTEST_MPS, SLOWEST_HZ
from trials.realism.measure import gradients, power_spectrum
from trials.realism.quantities import QUANTITIES, Measured
from vo.contract.arrays import Array, Image

Values = Mapping[str, float | str | bool]
GAMMA, BLACK, WHITE = (0.3, 4.0), (0.0, 90.0), (110.0, 900.0)
"""Ranges of the fitted curve."""
EVALUATIONS = 160
PREFERENCE = 0.05
"""Weight of the deviation from a standard curve: exposure, exponent and levels are much alike."""
LEVELS = np.arange(256)
STILL_PX = 0.5
"""Motion in the image up to which a camera stands still."""
STRIP_PX = 64
"""Height of the strips of pictures, every third one, that are used for the fit."""


def curve_of_values(values: Values) -> Curve:
    """Return the curve of settings by `key.path`."""
    response = "linear" if values.get("sensor.response") == "linear" else "srgb"
    standard = (("gamma", 1), ("black_grey", 0), ("white_grey", 255))
    return Curve(response, *(float(values.get(f"sensor.{x}", y)) for x, y in standard))


def corrected(values: Values, real: Measured, twin: Measured) -> dict[str, float]:
    """Return corrected noise and lens by `key.path`, those that can be told.

    Args:
        values: Settings with which the twin was recorded.
        real: Statistics of the real recording.
        twin: Those of the twin.
    """
    curve = curve_of_values(values)
    return _known(
        {
            "sensor.softness_px": _softness(values, real, twin),
            "sensor.vignetting": _shifted(values, real, twin),
            "sensor.right_gain": _scaled(values, real, twin),
            **_noise(values, (real, curve), (twin, curve)),
        }
    )


def with_speed(values: Values, real: Measured, twin: Measured) -> dict[str, float]:
    """Return also the corrected speed, or the frame rate; arguments as of `corrected`."""
    return {**corrected(values, real, twin), **_known(_motion(values, real, twin))}


def with_fitted_curve(
    values: Values, real: Measured, twin: Measured, far: Mapping[str, float]
) -> dict[str, float]:
    """Return the curve by `key.path`, and the noise that belongs to them.

    Args as of `corrected` and `fit_curve`; noise and lens of the twin should be corrected already.
    """
    before = curve_of_values(values)
    after = fit_curve(real, twin, before, far)
    found = {
        "sensor.gamma": after.gamma,
        "sensor.black_grey": after.black,
        "sensor.white_grey": after.white,
    }
    return _known({**found, **_noise(values, (real, after), (twin, before))})


def _known(found: Values) -> dict[str, float]:
    return {key: round(float(x), 6) for key, x in found.items() if math.isfinite(float(x))}


def fit_curve(real: Measured, twin: Measured, curve: Curve, far: Mapping[str, float]) -> Curve:
    """Fit the curve with which the twin's grey levels and contrasts are nearest to the real ones.

    Distances are those of the grey levels, gradients and power spectra of the twin's pictures. The
    exposure is a part of the curve: more light reaches its grey level with a higher level of full
    light.

    Args:
        real: Statistics of the real recording.
        twin: Those of the twin.
        curve: With which the twin was recorded.
        far: Distances by their names over which these are counted: those of the default picture.
    """
    light = levels_to_light(curve, LEVELS)
    wanted = {name: real.estimate(name) for name in ("grey", "gradient", "power")}
    target = {name: x[None] for name, x in wanted.items() if x is not None}
    share = twin.estimate("grey")
    assert share is not None  # every recording that could be measured has grey levels

    strips = [x[k : k + STRIP_PX] for x in twin.pictures for k in range(0, len(x), 3 * STRIP_PX)]

    def levels(parts: Array) -> Array:
        return np.clip(light_to_levels(_curve(curve, parts), light), 0, 255)

    def misfit(parts: Array) -> float:
        table = np.rint(levels(parts)).astype(np.uint8)
        parts_of = _statistics([table[x] for x in strips])
        parts_of["grey"] = np.bincount(table, share, 256)
        known = [n for n in target if len(parts_of[n]) == target[n].shape[1]]
        off = (distances(QUANTITIES[n], target[n], parts_of[n][None])[0] / far[n] for n in known)
        return float(sum(off)) + PREFERENCE * float(abs(parts).sum())

    start = np.array([math.log(curve.gamma), curve.black / 30, (curve.white - 255) / 100])
    simplex = start + np.vstack([np.zeros(3), np.diag([0.3, 0.5, -0.5])])
    options = {"maxfev": EVALUATIONS, "xatol": 0.01, "fatol": 0.003, "initial_simplex": simplex}
    best = minimize(misfit, start, method="Nelder-Mead", options=options).x
    return _curve(curve, best)


def _curve(curve: Curve, parts: Array) -> Curve:
    return Curve(
        curve.response,
        float(np.clip(math.exp(min(max(parts[0], -3.0), 3.0)), *GAMMA)),
        float(np.clip(30 * parts[1], *BLACK)),
        float(np.clip(255 + 100 * parts[2], *WHITE)),
    )


def _statistics(pictures: list[Image]) -> dict[str, Array]:
    histogram = np.sum([gradients(x) for x in pictures], axis=0)
    power = [p for x in pictures if len(p := power_spectrum(x))]
    return {
        "gradient": histogram / max(histogram.sum(), 1),
        "power": np.mean(power, axis=0) if power else np.zeros(0),
    }


def _softness(values: Values, real: Measured, twin: Measured) -> float:
    """Correct the point spread by the widths of edges, as variances."""
    now = float(values.get("sensor.softness_px", 0))
    widths = frequent_width(real), frequent_width(twin)
    return math.sqrt(max(now**2 + widths[0] ** 2 - widths[1] ** 2, 0.0))


def _shifted(values: Values, real: Measured, twin: Measured) -> float:
    pair = _both("vignetting", real, twin)
    return float(np.clip(float(values.get("sensor.vignetting", 0)) + pair[0] - pair[1], 0, 1))


def _scaled(values: Values, real: Measured, twin: Measured) -> float:
    pair = _both("right_gain", real, twin)
    return float(values.get("sensor.right_gain", 1)) * pair[0] / pair[1]


def _motion(values: Values, real: Measured, twin: Measured) -> dict[str, float]:
    """Correct the speed by the motion in the image, or the frame rate at full speed."""
    moved = [_usual_motion(x) for x in (real, twin)]
    speed, rate = (float(values.get(x, np.nan)) for x in ("drive.speed_mps", "rig.rate_hz"))
    wanted = speed * float(np.clip(moved[0] / moved[1], 0.5, 2))
    if not math.isfinite(wanted) or wanted <= 0:
        return {}
    reached = min(wanted, FASTEST_MPS)
    return {"drive.speed_mps": reached, "rig.rate_hz": max(rate * reached / wanted, SLOWEST_HZ)}


def _usual_motion(measured: Measured) -> float:
    """Return the median motion in the image, px a frame, but of halts; NaN without any."""
    share, x = measured.estimate("motion"), QUANTITIES["motion"].x
    if share is None or not share[x > STILL_PX].any():
        return np.nan
    moving = np.cumsum(np.where(x > STILL_PX, share, 0))
    return float(np.interp(0.5, moving / moving[-1], x))


def _both(name: str, real: Measured, twin: Measured) -> tuple[float, float]:
    found = [x.estimate(name) for x in (real, twin)]
    return tuple(np.nan if x is None else float(x[0]) for x in found)  # pyrefly: ignore


def _noise(
    values: Values, real: tuple[Measured, Curve], twin: tuple[Measured, Curve]
) -> dict[str, float]:
    """Correct shot and read noise, as variances; what the twin has too much is texture."""
    wanted, found = noise_parts(*real), noise_parts(*twin)
    if wanted is None or found is None:
        return {}
    well, read = (float(values.get(f"sensor.{x}", 0)) for x in ("full_well", "read_noise"))
    shot = 1 / well if well else 0.0
    made = np.array([shot, (read / (well or 10_000)) ** 2])
    full_well, read_noise = electrons(np.maximum(made + wanted - found, 0))
    return {"sensor.full_well": min(full_well, 200_000), "sensor.read_noise": min(read_noise, 1000)}
