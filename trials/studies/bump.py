"""One cause, many labels: what a brick under a wheel does to every channel; `driftyard bump`."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trials.execution.progress import ProgressBar, no_progress
from trials.execution.recording_settings import recording_settings
from vo.contract.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BASELINE = "corner_flow"
SECONDS = (2.0, 9.0)
"""What is shown, in the recording's own time."""
SHUTTER_MS = 35.0
INK, RED, BLUE, OCHRE = "#2b3036", "#c8401e", "#2a6fb0", "#b5820e"

Channel = tuple[Array, Array]
"""Times in seconds and values."""


def record_bumps(scene: str, seed: int, bar: ProgressBar = no_progress) -> dict[str, Channel]:
    """Drive over loose bricks: channels as of `read_channels`, and `features` that survive."""
    from sim.batch import build
    from sim.record import record
    from trials.estimators.choice import Named, estimate
    from trials.evaluation.runs import read_run

    overrides = [
        "drive.distance_m=3",
        "terrain.brick_mm=18",
        "terrain.brick_gap_m=0.6",
        f"exposure.time_ms={SHUTTER_MS}",
    ]
    settings = recording_settings(scene, seed, overrides)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / scene
        with bar(f"recording {scene}") as progress:
            record(build(scene, settings), settings, folder, progress=progress)
        estimate(Named(BASELINE), folder, folder.parent / "run.txt")
        run = read_run(folder.parent / "run.txt")
        assert run.frames is not None
        channels = read_channels(folder, settings.exposure.step_px)
        times_s = np.array(run.frames.timestamps_ns) * 1e-9
        channels["features"] = (times_s, run.frames.counts["inliers"])
    return channels


def read_channels(folder: Path, step_px: float) -> dict[str, Channel]:
    """Read what a recording says of its bumps.

    Args:
        folder: Dataset.
        step_px: Motion that one sub-frame stands for.

    Returns:
        Name to times and values: `left`, `right` and `caster` loads in newtons, `shock` in m/s²
        (vertical specific force less gravity), `pitch` in degrees per second, `blur` in pixels.
    """
    loads, inertia, shots = (
        np.loadtxt(folder / "mav0" / table, delimiter=",", ndmin=2)
        for table in ("contact0/data.csv", "imu0/data.csv", "cam0/exposure.csv")
    )
    channels = {
        wheel: (loads[:, 0] * 1e-9, loads[:, k])
        for k, wheel in enumerate(("left", "right", "caster"), start=1)
    }
    times_s = inertia[:, 0] * 1e-9
    channels["shock"] = (times_s, inertia[:, 6] - 9.81)
    channels["pitch"] = (times_s, np.degrees(inertia[:, 2]))
    channels["blur"] = (shots[:, 0] * 1e-9, step_px * shots[:, 3])
    return channels


def bump_summary(channels: Mapping[str, Channel]) -> str:
    """Say how the channels move together."""
    shock = channels["shock"]
    envelope = np.abs(shock[1])
    at_frames, blur = channels["blur"]
    nearby = np.array([envelope[np.abs(shock[0] - t) < 0.05].max(initial=0) for t in at_frames])
    shaken = nearby > np.quantile(nearby, 0.8)
    calm = nearby < np.quantile(nearby, 0.5)
    features = np.interp(at_frames, *channels["features"])
    return (
        f"shaken frames against calm ones: blur {blur[shaken].mean():.1f} against "
        f"{blur[calm].mean():.1f} px, features {features[shaken].mean():.0f} against "
        f"{features[calm].mean():.0f}; largest wheel load "
        f"{max(channels[w][1].max() for w in ('left', 'right', 'caster')):.0f} N"
    )


def draw(channels: Mapping[str, Channel], scene: str) -> "Figure":
    """Draw all channels above each other on one axis of time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 9), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(5, 1, sharex=True)
    rows = (
        ("wheel load, N", (("left", RED), ("right", BLUE), ("caster", OCHRE))),
        ("vertical\nacceleration, m/s²", (("shock", INK),)),
        ("pitch rate, °/s", (("pitch", INK),)),
        (f"blur in\n{SHUTTER_MS:g} ms, px", (("blur", INK),)),
        ("features that\nsurvive", (("features", INK),)),
    )
    impacts_s = _impacts_s(channels)
    for panel, (label, lines) in zip(panels, rows, strict=True):
        for time_s in impacts_s:
            panel.axvline(time_s, color="#f0d9a8", linewidth=3.0, zorder=0)
        _draw_panel(panel, label, {name: (channels[name], colour) for name, colour in lines})
    panels[0].legend(loc="upper right", fontsize=8, ncols=3, frameon=False)
    panels[-1].set_xlabel("time, s")
    figure.suptitle(f"Bricks under the wheels, {scene}", x=0.01, ha="left", weight="bold")
    return figure


def _impacts_s(channels: Mapping[str, Channel]) -> list[float]:
    """When a wheel bore more than twice what it bears at rest, once for each blow."""
    impacts: list[float] = []
    for wheel in ("left", "right", "caster"):
        times_s, loads = channels[wheel]
        for time_s in times_s[loads > 2 * np.median(loads)].tolist():
            if SECONDS[0] < time_s < SECONDS[1] and all(abs(time_s - t) > 0.15 for t in impacts):
                impacts.append(time_s)
    return impacts


def _draw_panel(panel: "Axes", label: str, lines: Mapping[str, tuple[Channel, str]]) -> None:
    for name, ((times_s, values), colour) in lines.items():
        shown = (times_s >= SECONDS[0]) & (times_s <= SECONDS[1])
        by_frame = len(times_s) < 1000 and name in ("blur", "features")
        (line,) = panel.plot(times_s[shown], values[shown], color=colour, linewidth=1.0, label=name)
        line.set_drawstyle("steps-mid" if by_frame else "default")
    panel.set_ylabel(label, fontsize=9)
    panel.grid(color="#e6e6e6", linewidth=0.6)
    panel.margins(x=0)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
