"""Charts of a report as SVG inside HTML."""

import re

import numpy as np
import pytest

from trials.evaluation.alignment import Alignment, Pair
from trials.evaluation.runs import FrameTable
from trials.report.charts import (
    MAX_POINTS,
    downsample,
    error_over_distance,
    legend_of,
    stage_counts,
    stage_timings,
)
from trials.report.figure import PALETTE, SERIES, css_colour, svg_markup
from trials.report.trajectory_plot import ground_axes, limits_around, plot_trajectories, turned
from vo.contract.estimator import Status


def frames(status, counts, timings_ms=None):
    """A table of one frame per second."""
    times = np.arange(len(status)) * 10**9
    reasons = ("",) * len(status)
    return FrameTable(times, tuple(status), reasons, times * 0.0, counts, timings_ms or {})


def straight(length):
    """Poses (length, 4, 4) along x, 1 m apart, cameras upright."""
    T = np.tile(np.eye(4), (length, 1, 1))
    T[:, :3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    T[:, 0, 3] = np.arange(length)
    return T


def test_downsample_averages_neighbours():
    x, y = downsample(np.arange(2.0 * MAX_POINTS), np.ones(2 * MAX_POINTS))
    assert len(x) == MAX_POINTS
    assert (y == 1).all()
    assert x[:2].tolist() == [0.5, 2.5]


def test_downsample_keeps_rare_values():
    y = np.full(2 * MAX_POINTS, np.nan)
    y[7] = 5
    _, short = downsample(np.arange(2.0 * MAX_POINTS), y)
    assert short[3] == 5
    assert np.isnan(np.delete(short, 3)).all()


def test_lines_break_at_nan_and_isolated_points_are_dots():
    counts = {"inliers": np.array([1, np.nan, 2, 3])}
    svg = stage_counts(frames([Status.TRACKED] * 4, counts)).svg
    colour = re.escape(css_colour(SERIES[0]))
    (line,) = (
        d
        for d, style in re.findall(r'<path d="([^"]*)"[^>]*style="([^"]*)"', svg)
        if re.search(rf"fill: none; stroke: {colour}", style)
    )
    assert (line.count("M"), line.count("L")) == (2, 1)  # only the last two points are joined
    assert len(re.findall(rf'<use [^>]*style="fill: {colour}', svg)) == 1


def test_frames_that_are_not_tracked_are_shaded():
    status = [Status.START, Status.TRACKED, Status.LOST, Status.LOST, Status.TRACKED]
    svg = stage_counts(frames(status, {"inliers": np.ones(5)})).svg
    assert re.findall(r'id="(\w+-from-\d)"', svg) == ["start-from-0", "lost-from-2"]


def test_svg_titles_and_labels_are_escaped():
    svg = svg_markup("<b>&", (3, 2), lambda figure: figure.subplots().set_xlabel("<i>&"))
    assert 'aria-label="&lt;b&gt;&amp;"' in svg
    assert "<i>" not in svg
    assert "&lt;i&gt;&amp;" in svg


def test_svg_colours_are_those_of_the_page():
    pair = Pair(np.arange(3), straight(3), straight(3))
    chart = error_over_distance({"a": pair, "b": pair}, Alignment.FIRST_POSE)
    assert re.findall("#[0-9a-f]{6}", chart.svg) == []
    names = set(re.findall(r"var\(--(\w+)\)", chart.svg))
    assert names <= set(PALETTE)
    assert {css_colour(colour) for colour in SERIES[:2]} == {colour for _, colour in chart.legend}


def test_legend_repeats_colours_after_the_last():
    colours = [colour for _, colour in legend_of(map(str, range(len(SERIES) + 1)))]
    assert len(set(colours)) == len(SERIES)
    assert colours[-1] == colours[0]


def test_charts_of_empty_and_constant_series_are_drawn():
    for counts in ({"a": np.full(3, np.nan)}, {"a": np.zeros(3)}, {}):
        assert stage_counts(frames([Status.TRACKED] * 3, counts)).svg.startswith("<svg")
    timings = {"a": np.zeros(3), "b": np.full(3, np.nan)}
    svg = stage_timings(frames([Status.TRACKED] * 3, {}, timings)).svg
    assert svg.rstrip().endswith("</svg>")


@pytest.mark.parametrize(
    ("down", "labels"),
    [
        # camera y in the world: KITTI's world is a camera (y down); a robot's has z up
        ([0, 1, 0], ["x", "z"]),
        ([0, 0, -1], ["x", "y"]),
    ],
)
def test_view_from_above_is_not_mirrored(down, labels):
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, 1] = down
    ground = ground_axes(T)
    for right, up in (ground, turned(ground)):
        toward_viewer = np.cross(right, up)
        assert np.allclose(toward_viewer, -np.array(down))
    assert sorted("xyz"[axis] for axis in ground.argmax(axis=1)) == labels


def test_trajectory_plot_keeps_the_aspect_ratio():
    pair = Pair(np.arange(11), straight(11), straight(11))
    estimates = {"a": straight(11)[:, :3, 3]}
    chart = plot_trajectories(pair, estimates, None, Alignment.FIRST_POSE)
    found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', chart.svg)
    assert found is not None
    width, height = map(float, found.groups())
    low, high = limits_around(np.array([[0.0, 0.0], [10.0, 0.0]]))
    assert height / width == pytest.approx((high - low)[1] / (high - low)[0], rel=1e-3)
