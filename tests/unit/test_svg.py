"""Charts: scales, ticks and broken lines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trials.report.plan import Ground, View
from trials.report.svg import MOST_POINTS, Axes, line_chart, stacked_chart, thin, ticks, trace


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e4))
def test_ticks_are_few_round_and_inside(low, size):
    found = ticks(low, low + size)
    assert 2 <= len(found) <= 11
    assert (found >= low - 1e-6 * size).all()
    assert (found <= low + (1 + 1e-6) * size).all()


def test_hand_worked_ticks():
    assert ticks(0, 10).tolist() == [0, 2, 4, 6, 8, 10]
    assert ticks(-0.3, 0.3).tolist() == [-0.2, 0, 0.2]


def test_lines_break_at_nan_and_lone_points_stay_visible():
    x, y = np.arange(4.0), np.array([1, np.nan, 2, 3])
    assert trace(x, y) == "M0.0 1.0h0M2.0 2.0h0L3.0 3.0"


def test_axes_point_up():
    axes = Axes((0, 1), (0, 1))
    assert axes.py(1) < axes.py(0)
    assert axes.px(1) > axes.px(0)


def test_thinning_averages():
    x, y = thin(np.arange(2.0 * MOST_POINTS), np.ones(2 * MOST_POINTS))
    assert len(x) == MOST_POINTS
    assert (y == 1).all()
    assert x[:2].tolist() == [0.5, 2.5]


def test_thinning_keeps_what_is_rare():
    y = np.full(2 * MOST_POINTS, np.nan)
    y[7] = 5
    _, thinned = thin(np.arange(2.0 * MOST_POINTS), y)
    assert thinned[3] == 5
    assert np.isnan(np.delete(thinned, 3)).all()


def test_names_are_escaped():
    chart = line_chart("<b>", {"<i>": (np.zeros(2), np.zeros(2))}, "<u>", "&")
    assert not any(tag in chart.svg for tag in ("<b>", "<i>", "<u>"))


def test_empty_and_constant_curves_draw():
    nothing = np.zeros(0)
    for series in ({"a": (nothing, nothing)}, {"a": (np.zeros(3), np.full(3, np.nan))}, {}):
        assert line_chart("t", series, "x", "y").svg.startswith("<svg")
    assert stacked_chart("t", np.arange(3.0), {"a": np.zeros(3)}, "x", "y").svg.endswith("</svg>")


@pytest.mark.parametrize(
    ("down", "labels"),
    [
        # camera y in the world: KITTI's world is a camera (y down); a robot's has z up
        ([0, 1, 0], ["z", "x"]),
        ([0, 0, -1], ["x", "y"]),
    ],
)
def test_the_view_from_above_is_not_mirrored(down, labels):
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, 1] = down
    ground = Ground.below(T)
    right, up = np.eye(3)[ground.axes[0]], np.eye(3)[ground.axes[1]]
    toward_viewer = np.cross(right * ground.signs[0], up * ground.signs[1])
    assert np.allclose(toward_viewer, -np.array(down))
    turned = ground.turned()
    right, up = np.eye(3)[turned.axes[0]], np.eye(3)[turned.axes[1]]
    toward_viewer = np.cross(right * turned.signs[0], up * turned.signs[1])
    assert np.allclose(toward_viewer, -np.array(down))
    assert sorted(ground.labels) == sorted(labels)


def test_the_plan_keeps_shapes():
    view = View.around(np.array([[0.0, 0.0], [10.0, 1.0]]))
    a, b = view.place(np.array([[0.0, 0.0], [1.0, 1.0]]))
    assert b[0] - a[0] == pytest.approx(a[1] - b[1])
