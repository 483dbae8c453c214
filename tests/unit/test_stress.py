"""Search for the strength at which an estimator fails, where it is known."""

from collections.abc import Sequence

import pytest

from sim.disturbances import parse_disturbances
from trials.execution.recording_settings import recording_settings
from trials.studies.stress import AXES, MAIN, Axis, Curve, Limits, Response, describe, stress
from trials.studies.stress_report import page_text, rows_of, write_curves, write_page

AXIS = Axis("strength", 8.0)


def respond(strengths: Sequence[float]) -> list[Response]:
    """Two drives whose drift is a tenth more than the strength, in %."""
    return [Response(x, (0, 1), (0.1 + x, 0.1 + x), (0.0, 0.0)) for x in strengths]


def search(limit: float, rounds: int = 6) -> Curve:
    return stress(AXIS, "office", respond, 3, rounds, Limits(drift_percent=limit))


@pytest.mark.parametrize("limit", [0.3, 2.5, 7.9])
def test_stress_bisection_brackets_the_failure(limit):
    curve = search(0.1 + limit)
    assert curve.bracket is not None
    low, high = curve.bracket
    assert low <= limit <= high
    assert high - low == pytest.approx(4.0 / 2**6)
    assert "Fails between" in describe(curve)


def test_stress_without_failure_has_no_bracket():
    curve = search(100.0)
    assert curve.bracket is None
    assert len(curve.responses) == 3  # nothing to bisect
    assert describe(curve).startswith("Tolerates all strengths up to 8")


def test_stress_failure_without_disturbance_is_described():
    curve = search(0.01)
    assert curve.bracket == (0.0, 0.0)
    assert "without any disturbance" in describe(curve)


def test_rows_of_curves_are_the_drives():
    rows = rows_of({"one": search(2.0, rounds=1), "other": search(5.0, rounds=0)})
    assert {len(row) for row in rows} == {5}
    assert [row[0] for row in rows] == ["one"] * 8 + ["other"] * 6


def test_page_states_where_each_estimator_fails(tmp_path):
    curves = {"one": search(2.6), "other": search(100.0), "third": search(0.01)}
    figure = write_curves("noise", curves, tmp_path / "out")
    page = tmp_path / "docs/stress.md"
    write_page({"noise": curves}, {"noise": figure}, "driftyard stress noise", page)
    text = page.read_text()
    assert text == page_text({"noise": curves}, "driftyard stress noise")
    assert "| strength | office | 2.5 to 2.56 | none up to 8 | 0: undisturbed |" in text
    assert "more than half of 2 drives" in text
    assert (page.parent / "images/stress/noise.png").read_bytes() == figure.read_bytes()


def test_axis_disturb_converts_the_unit():
    assert MAIN["noise"].disturb(6.0) == "noise=2"
    assert AXES["slip"].disturb(1.5) == "slip=1.5"
    assert AXES["slip"].disturb(0.0) == ""


@pytest.mark.parametrize("name", AXES)
def test_axis_settings_are_accepted_over_its_range(name):
    axis = AXES[name]
    for strength in (axis.minimum, axis.maximum / 2, axis.maximum):
        overrides, disturb = list(axis.overrides(strength)), axis.disturb(strength)
        parse_disturbances(disturb)
        recording_settings(axis.scene, 0, overrides, None, disturb)
