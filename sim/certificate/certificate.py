"""The certificate: summary of the photometric residuals and the plausibility checks."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from sim.certificate.photometric import BINS_PER_GREY, METHOD, FrameResidual, Residual, quantile
from sim.settings import RecordSettings


def exempt_parts(settings: RecordSettings) -> frozenset[str]:
    """Return the parts that cannot fail, because not all pixels were exposed at one time.

    Labels hold for both cameras at once and for the middle row; the residuals are only reported.
    """
    exposure = settings.exposure
    stereo = {"stereo"} if exposure.right_offset_ms != 0 else set[str]()
    return frozenset(stereo | ({"flow"} if exposure.line_time_us > 0 else set()))


def certify(
    frames: Iterable[FrameResidual], checks: dict[str, Any], exempt: frozenset[str] = frozenset()
) -> dict[str, Any]:
    """Return the manifest's `certificate`: the same images and labels always give the same numbers.

    Checks come from `plausibility.check_folder`, each with its own `passed`; exempt parts, from
    `exempt_parts`, cannot fail.
    """
    frames = list(frames)
    stereo = {frame.timestamp_ns: frame.stereo for frame in frames}
    flow = {frame.timestamp_ns: frame.flow for frame in frames if frame.flow is not None}
    parts = {"stereo": _summary(stereo, "stereo" not in exempt)}
    if flow:
        parts["flow"] = _summary(flow, "flow" not in exempt)
    return {
        **METHOD,
        **parts,
        **checks,
        "passed": all(part["passed"] for part in [*parts.values(), *checks.values()]),
    }


def _summary(residuals: dict[int, Residual], judged: bool) -> dict[str, Any]:
    total = np.sum([r.histogram for r in residuals.values()], axis=0)
    levels = np.arange(len(total)) / BINS_PER_GREY
    worst_ns, worst = max(residuals.items(), key=lambda item: (item[1].median, -item[0]))
    visible = np.mean([r.visible_fraction for r in residuals.values()])
    failed = [time_ns for time_ns, r in residuals.items() if judged and not r.passed]
    return {
        "median_grey": quantile(total, 0.5),
        "rms_grey": round(float(np.sqrt((total * levels**2).sum() / max(total.sum(), 1))), 4),
        "p95_grey": quantile(total, 0.95),
        "noise_median_grey": _median([r.noise_median for r in residuals.values()]),
        "shifted_median_grey": _median([r.shifted_median for r in residuals.values()]),
        "visible_fraction": round(float(visible), 6),
        "worst_frame_ns": worst_ns,
        "worst_frame_median_grey": worst.median,
        "judged": judged,
        "failed_frames_ns": failed,
        "passed": not failed,
    }


def _median(values: Sequence[float]) -> float:
    return round(float(np.median(values)), 4)
