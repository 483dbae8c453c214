"""The first look: world, status, both images, plots and log."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from trials.view import rerun_sdk as rr
from trials.view.recording_log import (
    ACCEL,
    DEPTH,
    GYRO,
    LEFT,
    RIGHT,
    TRUTH,
    WHEELS,
    WORLD,
)
from trials.view.run_log import ERRORS, LOG, PLOTS, RUNS, STATUS
from trials.view.stream import FRAME, TIME
from vo.contract.arrays import Array

SENSORS = {GYRO: "angular rate, rad/s", ACCEL: "specific force, m/s²", WHEELS: "wheels, ticks"}
"""Entity to the title of its plot."""


def blueprint(
    *,
    names: Sequence[str],
    positions: Array,
    up: Array,
    errors: Iterable[str],
    has_scene: bool,
    has_depth: bool,
    sensors: Sequence[str],
) -> Any:
    """Lay out views of what there is.

    Args:
        names: Runs, as parts of paths.
        positions: (N, 3) a path that the first look shows as a whole, metres in the world.
        up: (3,) axis of the world that points up.
        errors: Those of ERRORS that are known.
        has_scene: Whether there are triangles of the world, which depth would cover.
        has_depth: Whether there are images of depth.
        sensors: Entities of other sensors.
    """
    world = [_world(names, positions, up, has_scene)]
    if names:
        world.append(rr.blueprint.StateTimelineView(origin=STATUS, name="Status"))
    left = rr.blueprint.Spatial2DView(
        origin=LEFT, contents=["$origin/**", f"- {DEPTH}"], name="Left"
    )
    images = rr.blueprint.Horizontal(left, rr.blueprint.Spatial2DView(origin=RIGHT, name="Right"))
    plots = _plots(errors, len(names))
    tabs = [rr.blueprint.TextLogView(origin=LOG, name="Log")] if names else []
    if has_depth:
        tabs.append(rr.blueprint.Spatial2DView(origin=LEFT, contents=[DEPTH], name="Depth"))
    tabs += [rr.blueprint.TimeSeriesView(origin=x, name=SENSORS[x]) for x in sensors]
    below = [rr.blueprint.Grid(*plots, grid_columns=min(2, len(plots)))] if plots else []
    below += [rr.blueprint.Tabs(*tabs)] if tabs else []
    return rr.blueprint.Blueprint(
        rr.blueprint.Horizontal(
            rr.blueprint.Vertical(*world, row_shares=[9, 0.6 + 0.7 * len(names)][: len(world)]),
            rr.blueprint.Vertical(images, *below, row_shares=[3, 3, 2][: 1 + len(below)]),
        ),
        rr.blueprint.TimePanel(timeline=TIME, state="collapsed"),
        rr.blueprint.BlueprintPanel(state="collapsed"),
        rr.blueprint.SelectionPanel(state="collapsed"),
    )


def _world(names: Sequence[str], positions: Array, up: Array, has_scene: bool) -> Any:
    growing = [f"{TRUTH}/path", *(f"{RUNS}/{x}/{y}" for x in names for y in ("path", "map"))]
    contents = [
        "$origin/**",
        f"- {LEFT}/features/**",
        f"- {RIGHT}/features/**",
        f"- {LEFT}/tracks/**",
    ]
    if has_scene:
        contents.append(f"- {DEPTH}")
    return rr.blueprint.Spatial3DView(
        origin=WORLD,
        name="World",
        contents=contents,
        overrides={path: until_now() for path in growing},
        eye_controls=_eye(positions, up),
    )


def until_now() -> Any:
    """Return all times until that of the cursor."""
    start, end = rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.cursor_relative()
    return rr.blueprint.VisibleTimeRanges(
        [rr.blueprint.VisibleTimeRange(timeline=x, start=start, end=end) for x in (FRAME, TIME)]
    )


def _eye(positions: Array, up: Array) -> Any:
    """Return an eye above and behind a path (N, 3), which sees all of it; None without."""
    known = positions[~np.isnan(positions).any(axis=1)]
    if not len(known):
        return None
    low, high = known.min(axis=0), known.max(axis=0)
    centre, reach_m = (low + high) / 2, max(float(np.linalg.norm(high - low)), 1.2)
    ahead = known[min(1 + len(known) // 4, len(known) - 1)] - known[0]
    ahead -= (ahead @ up) * up
    if (length := float(np.linalg.norm(ahead))) < 1e-3 * reach_m:
        ahead, length = np.roll(up, 1), 1.0
    position = centre + reach_m * (0.8 * up - 0.9 * ahead / length)
    return rr.blueprint.EyeControls3D(position=position, look_target=centre, eye_up=up)


def _plots(errors: Iterable[str], runs: int) -> list[Any]:
    """Return plots of errors of some runs; one needs no legend."""
    legend = rr.blueprint.PlotLegend(visible=runs > 1)
    return [
        rr.blueprint.TimeSeriesView(origin=f"{PLOTS}/{x}", name=ERRORS[x], plot_legend=legend)
        for x in errors
        if runs
    ]
