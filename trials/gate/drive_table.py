"""Table of a check of the gate: one row for each drive."""

from pathlib import Path

from trials.gate.baseline import Measurement
from trials.gate.comparison import Comparison
from trials.report.columns import columns_file

FIGURES = {"drift_percent": float, "lost_frames": int, "frame_ms": float, "reference_ms": float,
           "nees": float}  # fmt: skip
SCHEMA = (
    {"scene": str, "seed": int, "sha256": str, "estimator": str, "baseline": str, "frames": int}
    | {f"{side}_{x}": kind for x, kind in FIGURES.items() for side in ("baseline", "now")}
    | {"baseline_is_lost": bool, "now_is_lost": bool, "log_drift_ratio": float, "problem": str}
)


def write_checked_drives(path: Path, found: Comparison) -> None:
    """Write the figures of both estimators on each sequence, and the log ratio of their drift.

    Raises:
        SettingsError: As `columns_file`.
    """
    known = found.baseline
    rows = [
        {"scene": row.scene, "seed": row.seed, "sha256": row.sha256}
        | {"estimator": found.estimator, "baseline": known.estimator, "frames": now.frames}
        | _side("baseline", row.measured)
        | _side("now", now)
        | {"log_drift_ratio": now.log_drift - row.measured.log_drift, "problem": now.problem}
        for row, now in zip(known.sequences, found.measured, strict=True)
    ]
    with columns_file(path, SCHEMA) as append:
        append({name: [row[name] for row in rows] for name in SCHEMA})


def _side(name: str, measured: Measurement) -> dict[str, object]:
    figures = {f"{name}_{x}": getattr(measured, x) for x in FIGURES}
    return figures | {f"{name}_is_lost": measured.is_lost}
