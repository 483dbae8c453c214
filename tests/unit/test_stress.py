"""The search for the breaking point, on estimators whose breaking point is known."""

from collections.abc import Sequence

import pytest

from sim.disturbances import parse_disturbances
from trials.execution.recording_settings import recording_settings
from trials.studies.strengths import AXES, MAIN, Axis
from trials.studies.stress import Curve, Limits, Response, stress, verdict
from trials.studies.stress_report import columns, page_text, write_curves, write_page

AXIS = Axis("strength", 8.0)


def respond(strengths: Sequence[float]) -> list[Response]:
    """Two drives whose drift is a tenth more than the strength, in %."""
    return [Response(x, (0, 1), (0.1 + x, 0.1 + x), (0.0, 0.0)) for x in strengths]


def search(limit: float, rounds: int = 6) -> Curve:
    return stress(AXIS, "office", respond, 3, rounds, Limits(drift_percent=limit))


@pytest.mark.parametrize("breaking", [0.3, 2.5, 7.9])
def test_halving_finds_the_breaking_point(breaking):
    curve = search(0.1 + breaking)
    assert curve.bracket is not None
    low, high = curve.bracket
    assert low <= breaking <= high
    assert high - low == pytest.approx(4.0 / 2**6)
    assert "Breaks between" in verdict(curve)


def test_what_bears_all_has_no_breaking_point():
    curve = search(100.0)
    assert curve.bracket is None
    assert len(curve.responses) == 3  # nothing to halve
    assert verdict(curve).startswith("Bears all up to 8")


def test_what_is_broken_from_the_start_is_said():
    curve = search(0.01)
    assert curve.bracket == (0.0, 0.0)
    assert "as it is" in verdict(curve)


def test_every_drive_is_a_row():
    table = columns({"one": search(2.0, rounds=1), "other": search(5.0, rounds=0)})
    assert {len(values) for values in table.values()} == {8 + 6}
    assert table["estimator"] == ["one"] * 8 + ["other"] * 6


def test_the_page_says_where_each_breaks(tmp_path):
    curves = {"one": search(2.6), "other": search(100.0), "third": search(0.01)}
    figure = write_curves("noise", curves, tmp_path / "out")
    page = tmp_path / "docs/stress.md"
    write_page({"noise": curves}, {"noise": figure}, "driftyard stress noise", page)
    text = page.read_text()
    assert text == page_text({"noise": curves}, "driftyard stress noise")
    assert "| strength | office | 2.5 to 2.56 | none up to 8 | 0: as it is |" in text
    assert "2 drives at each strength" in text
    assert (page.parent / "images/stress/noise.png").read_bytes() == figure.read_bytes()


def test_a_disturbance_has_the_strength_of_its_unit():
    assert MAIN["noise"].disturb(6.0) == "noise=2"
    assert AXES["slip"].disturb(1.5) == "slip=1.5"
    assert AXES["slip"].disturb(0.0) == ""


@pytest.mark.parametrize("name", AXES)
def test_every_axis_makes_settings_over_its_reach(name):
    axis = AXES[name]
    for strength in (axis.least, axis.reach / 2, axis.reach):
        overrides, disturb = list(axis.overrides(strength)), axis.disturb(strength)
        parse_disturbances(disturb)
        recording_settings(axis.scene, 0, overrides, None, disturb)
