"""Model of the cost of a frame, on costs that are made up."""

from dataclasses import replace

import pytest

from trials.studies.speed.cost_model import CostModel, Line, million_frames
from trials.studies.speed.costs import (
    CHECKS,
    IMAGES,
    LABELS,
    Conditions,
    Cost,
    design,
)

SCENES = {"brick_court": (3, 80, 1.0), "office": (2, 60, 0.4), "long_haul": (60, 90, 1.6)}


def made_up(x: Conditions) -> Cost:
    """A scene has its own time of images and labels, and bytes; labels share nothing."""
    fixed, per_mpx, dense = SCENES[x.scene]
    labels_ms = dense * (1 + 100 * x.megapixels) * len(x.labels) / len(LABELS)
    camera = {"noise": 4.0}.get(x.camera, 1.0 if x.camera else 0.0)
    kb = dict.fromkeys((IMAGES, *x.labels), 500 * dense * x.megapixels**0.8)
    kb[IMAGES] *= 1.5 if x.camera else 1.0
    return Cost(12, fixed + per_mpx * x.megapixels + labels_ms + camera, kb, 3.0, 0.5)


def test_cost_model_recovers_costs_of_its_form():
    model = CostModel.fit({x: made_up(x) for x in design(quick=True)})
    assert model.scenes["long_haul"].images.fixed == pytest.approx(60)
    assert model.scenes["office"].kb["flow"].exponent == pytest.approx(0.8)
    for x in CHECKS:
        assert model.frame_ms(x) == pytest.approx(made_up(x).frame_ms)
        assert model.frame_kb(x) == pytest.approx(made_up(x).frame_kb)
    hours, gb = million_frames(model, Conditions())
    assert hours == pytest.approx(made_up(Conditions()).frame_ms / 3.6)
    assert gb == pytest.approx(made_up(Conditions()).frame_kb * 1e6 / 2**20)


def test_cost_of_a_factor_is_never_negative():
    costs = {x: made_up(x) for x in design(quick=True)}
    costs |= {x: replace(y, frame_ms=1.0) for x, y in costs.items() if x.camera == "noise"}
    assert CostModel.fit(costs).cameras["noise"] == Line(0, 0)


def test_design_has_every_label_and_scene_once():
    rows = design(quick=False)
    assert len(rows) == len(set(rows))
    assert {x for row in rows for x in row.labels} >= {"depth", "normals", "flow"}
    assert not set(rows) & set(CHECKS)
