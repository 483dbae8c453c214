"""Walks: steady laps, crossings at their times, feet that stand on the ground."""

import numpy as np
import pytest

from scenes.geometry.routes import rounded_loop
from scenes.objects.people import LEG_M, Crossing, Lap, clothing_atlas, person
from scenes.stage import Stage

SQUARE = rounded_loop(np.array([(2.0, -2), (2, 2), (-2, 2), (-2, -2)]), radius_m=0.8)


@pytest.mark.parametrize("pace", [0.7, -0.7])
def test_lap_has_its_pace_and_faces_its_direction(pace):
    lap = Lap(SQUARE, pace, 1.0)
    for time_s in np.linspace(0, 40, 57):
        (here, heading, _), (soon, _, _) = lap(time_s), lap(time_s + 0.05)
        step = soon - here
        assert np.linalg.norm(step) == pytest.approx(0.05 * 0.7, rel=0.02)
        assert step @ (np.cos(heading), np.sin(heading)) > 0.9 * np.linalg.norm(step)


def test_crossing_waits_walks_and_returns():
    walk = Crossing(np.zeros(2), np.array([4.0, 0]), np.array([10.0, 30.0]), 1.0)
    places = {t: walk(t)[0][0] for t in (0.0, 9.9, 12.0, 20.0, 31.0, 60.0)}
    assert list(places.values()) == pytest.approx([0, 0, 2, 4, 3, 0])
    assert np.cos(walk(12.0)[1]) == pytest.approx(1)
    assert np.cos(walk(31.0)[1]) == pytest.approx(-1)


def test_person_one_foot_is_always_on_the_ground():
    stage = Stage("street")
    rng = np.random.default_rng(0)
    stage.material("clothes", clothing_atlas(rng))
    person(stage, "pedestrian", rng, Lap(SQUARE, 1.0, 0.0))
    legs = [motion for name, motion in stage.movers.items() if name.endswith("leg")]
    assert len(legs) == 2
    hip = legs[0](0.0)[2, 3]
    assert 0.9 * LEG_M < hip < 1.06 * LEG_M
    for time_s in np.linspace(0, 3, 31):
        soles = [(motion(time_s) @ (0, 0, -hip, 1))[2] for motion in legs]
        assert min(soles) == pytest.approx(0, abs=1e-9)
