"""Model of the cost of a frame, on costs that are made up."""

import pytest

from trials.studies.speed.costs import (
    CHECKS,
    Conditions,
    CostModel,
    Line,
    design,
    million_frames,
    relative_errors,
)


def made_up(conditions):
    scene = {"brick_court": (3, 80), "office": (2, 60), "long_haul": (60, 90)}[conditions.scene]
    lines = {"depth": (1, 20), "flow": (0, 90), "noise": (4, 0)}
    parts = [lines.get(x, (1, 1)) for x in (*conditions.labels, conditions.camera) if x]
    return sum(a + b * conditions.megapixels for a, b in (scene, *parts))


def test_cost_model_recovers_costs_of_its_form():
    model = CostModel.fit({x: made_up(x) for x in design(quick=True)})
    assert model.scenes["long_haul"].fixed == pytest.approx(60)
    assert model.extra["flow"].per_mpx == pytest.approx(90)
    assert relative_errors(model, {x: made_up(x) for x in CHECKS}) == pytest.approx([0] * 5)
    hours, gb = million_frames(model, model, Conditions())
    assert hours == pytest.approx(made_up(Conditions()) / 3.6)
    assert gb == pytest.approx(made_up(Conditions()) * 1e6 / 2**20)


def test_cost_of_a_factor_is_never_negative():
    costs = {x: made_up(x) - (30 if x.labels == ("depth",) else 0) for x in design(quick=True)}
    assert CostModel.fit(costs).extra["depth"] == Line(0, 0)


def test_design_has_every_label_and_scene_once():
    rows = design(quick=False)
    assert len(rows) == len(set(rows))
    assert {x for row in rows for x in row.labels} >= {"depth", "normals", "flow"}
    assert not set(rows) & set(CHECKS)
