"""`driftyard calibrate`: what a recording shows of the calibration of its pair."""

import json
from pathlib import Path

import typer
from rich.table import Table

import driftyard
from trials.cli import console
from trials.cli.options import Dataset, FrameOptions, option
from trials.report.row_plot import save_row_plot
from trials.report.tables import text_table
from vo.contract.files import known_suffix
from vo.recording_calibration import UNOBSERVED, Calibration

SHOWN = {
    "pitch_rad": ("pitch", "deg"),
    "roll_rad": ("roll", "deg"),
    "keystone_rad": ("keystone (yaw)", "deg"),
    "delay_s": ("delay", "ms"),
    "row_px": ("centre along v", "px"),
    "magnification": ("focal length", "%"),
    "drop": ("height / baseline", "%"),
    "advance": ("advance / baseline", "%"),
}
"""Names of the quantities in the table, and units."""
UNITS = {"deg": 57.29577951308232, "ms": 1e3, "px": 1.0, "%": 100.0}
"""Units of the table in one of the quantity."""


def calibrate(
    dataset: Dataset,
    frames: FrameOptions,
    as_json: bool = option(False, "Print all figures as JSON.", "--json"),
    picture: Path | None = option(None, "Picture of the rows before and after, PNG.", "--picture"),
    out: Path | None = option(
        None, "File for the corrected cameras, Kalibr's camchain (YAML).", "--out"
    ),
) -> None:
    """Estimate errors of a stereo calibration from the recording itself, with standard errors.

    Nothing is changed. `driftyard run` corrects what is significant, from 0.25 px on.
    """
    if picture:
        known_suffix(picture, (".png",))
    opened = frames.open(dataset)
    with console.progress_bar("calibrating") as progress:
        found = driftyard.calibrate(opened, progress=progress)
    if out:
        found.save(out)
    if picture:
        save_row_plot(picture, found)
    if as_json:
        typer.echo(json.dumps(found.to_dict(), indent=1))
        return
    console.out.print(_table(opened.name, found))
    console.out.print(f"not observable, left as stated: {', '.join(UNOBSERVED)}", markup=False)


def _table(name: str, found: Calibration) -> Table:
    """Lay out one row per quantity."""
    rows: list[tuple[str, ...]] = []
    for x in found.quantities:
        label, unit = SHOWN[x.name]
        value, error = (f"{y * UNITS[unit]:.4f}" for y in (x.value, x.standard_error))
        significant = "yes" if x.significant else "no"
        rows.append((label, f"{value} {unit}", error, significant, f"{x.effect_px:.3f}"))
    for sensor, clock in found.clocks.items():
        value, error = (f"{1e3 * y:.4f}" for y in clock)
        rows.append((f"clock of {sensor}", f"{value} ms", error, "", ""))
    if found.line_time:
        value, error = (f"{1e6 * y:.4f}" for y in found.line_time)
        significant = "yes" if found.line_time_s != found.rig.line_time_s else "no"
        rows.append(("line time", f"{value} us", error, significant, ""))
    before, after = found.estimate.row_px
    title = (
        f"{name}, right camera against left: {len(found.samples)} points, "
        f"rows {before:.3f} px, corrected {after:.3f} px"
    )
    header = "quantity", "estimate", "std. error", "significant", "effect, px"
    return text_table(header, rows, title)
