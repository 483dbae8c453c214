"""Effect of bricks under the wheels on all channels of a recording; `driftyard bump`."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from sim.batch import build
from sim.record import record
from trials.estimators.choice import Named, estimate
from trials.evaluation.runs import read_run
from trials.execution.progress import ProgressBar, no_progress
from trials.execution.recording_settings import recording_settings
from trials.report.figure import BLUE, INK, OCHRE, RED, save_figure, tidy
from vo.contract.arrays import Array

BASELINE = "corner_flow"
SECONDS = (2.0, 9.0)
"""Interval of the figure, seconds of the recording."""
SHUTTER_MS = 35.0
WHEELS = {"left": RED, "right": BLUE, "caster": OCHRE}
PANELS = {
    "wheel load, N": WHEELS,
    "vertical\nacceleration, m/s²": {"shock": INK},
    "pitch rate, °/s": {"pitch": INK},
    f"blur in\n{SHUTTER_MS:g} ms, px": {"blur": INK},
    "inlier\nfeatures": {"features": INK},
}
"""Label of a panel to the colour of each channel in it."""

Channel = tuple[Array, Array]
"""Times in seconds and values."""


def record_bumps(
    scene: str, seed: int, camera: str, bar: ProgressBar = no_progress
) -> dict[str, Channel]:
    """Record a drive over loose bricks; returns `read_channels` and the inlier `features`."""
    overrides = ("drive.distance_m=3", "terrain.brick_mm=18", "terrain.brick_gap_m=0.6",
                 f"exposure.time_ms={SHUTTER_MS}")  # fmt: skip
    settings = recording_settings(scene, seed, overrides, camera=camera)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / scene
        with bar(f"recording {scene}") as progress:
            record(build(scene, settings), settings, folder, progress=progress)
        estimate(Named(BASELINE), folder, folder.parent / "run.txt")
        frames = read_run(folder.parent / "run.txt").frames
        assert frames is not None
        channels = read_channels(folder, settings.exposure.step_px)
    return channels | {"features": (frames.timestamps_ns * 1e-9, frames.counts["inliers"])}


def read_channels(folder: Path, step_px: float) -> dict[str, Channel]:
    """Read the channels of a recording that bumps affect.

    Args:
        folder: Dataset.
        step_px: Image motion per sub-frame.

    Returns:
        Name to times and values: `left`, `right` and `caster` loads in newtons, `shock` in m/s²
        (vertical specific force less gravity), `pitch` in degrees per second, `blur` in pixels.
    """
    loads, inertia, shots = (
        np.loadtxt(folder / "mav0" / table, delimiter=",", ndmin=2).T
        for table in ("contact0/data.csv", "imu0/data.csv", "cam0/exposure.csv")
    )
    channels = {wheel: (loads[0] * 1e-9, loads[k]) for k, wheel in enumerate(WHEELS, start=1)}
    return channels | {
        "shock": (inertia[0] * 1e-9, inertia[6] - 9.81),
        "pitch": (inertia[0] * 1e-9, np.degrees(inertia[2])),
        "blur": (shots[0] * 1e-9, step_px * shots[3]),
    }


def bump_summary(channels: Mapping[str, Channel]) -> str:
    """Describe blur and features of frames with and without shocks."""
    shock_s, shock = channels["shock"]
    at_frames, blur = channels["blur"]
    nearby = np.array([np.abs(shock[np.abs(shock_s - t) < 0.05]).max(initial=0) for t in at_frames])
    shaken = nearby > np.quantile(nearby, 0.8)
    calm = nearby < np.quantile(nearby, 0.5)
    features = np.interp(at_frames, *channels["features"])
    return (
        f"frames with shocks compared with calm ones: blur {blur[shaken].mean():.1f} against "
        f"{blur[calm].mean():.1f} px, features {features[shaken].mean():.0f} against "
        f"{features[calm].mean():.0f}; largest wheel load "
        f"{max(channels[wheel][1].max() for wheel in WHEELS):.0f} N"
    )


def draw_bumps(channels: Mapping[str, Channel], scene: str, out: Path) -> None:
    """Draw all channels over time, one panel below the other, as PNG."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(PANELS), 1, sharex=True)
        for panel, (label, colours) in zip(panels, PANELS.items(), strict=True):
            for time_s in _impacts_s(channels):
                panel.axvline(time_s, color=OCHRE, alpha=0.3, linewidth=3.0, zorder=0)
            for name, colour in colours.items():
                times_s, values = channels[name]
                shown = (times_s >= SECONDS[0]) & (times_s <= SECONDS[1])
                style = "steps-mid" if name in ("blur", "features") else "default"
                line = panel.plot(times_s[shown], values[shown], color=colour, lw=1.0, label=name)
                line[0].set_drawstyle(style)
            panel.margins(x=0)
            tidy(panel, "", label)
        panels[0].legend(loc="upper right", ncols=3)
        panels[-1].set_xlabel("time, s")
        figure.suptitle(f"Bricks under the wheels, {scene}", x=0.01, ha="left", weight="bold")

    save_figure(out, (10, 9), draw)


def _impacts_s(channels: Mapping[str, Channel]) -> list[float]:
    """Return the times at which a wheel load exceeds twice its median, once for each impact."""
    impacts: list[float] = []
    for wheel in WHEELS:
        times_s, loads = channels[wheel]
        for time_s in times_s[loads > 2 * np.median(loads)].tolist():
            if SECONDS[0] < time_s < SECONDS[1] and all(abs(time_s - t) > 0.15 for t in impacts):
                impacts.append(time_s)
    return impacts
