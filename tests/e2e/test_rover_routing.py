"""The rover on planned routes: doors, loads, and times against those of the model."""

import numpy as np
import pytest
from gym_worlds import write_yard
from terminal import driftyard

from trials.gym.env.settings import NavSettings
from trials.gym.studies.aisle_network import build_aisle_network
from trials.gym.studies.rover_routing import drive_layout
from vo.contract.errors import SettingsError

OPTIONS = {
    "scene": "warehouse",
    "scene_options": {"stock": 1.0, "aisles": 2, "bays": 2},
    "observe": ("pose",),
    "localization": "truth",
    "rate_hz": 10.0,
    "time_limit_s": 300.0,
    "distance_m": (1.0, 100.0),
}


@pytest.mark.slow
def test_aisle_network_of_two_aisles():
    aisles = build_aisle_network(NavSettings.model_validate(OPTIONS).build(0), 0.5)
    network = aisles.network
    assert network.names == ("left 1", "door 1", "right 1", "left 2", "door 2", "right 2")
    assert len(network.lengths_m) == 2 * (4 + 2)
    # Half an aisle is half of two bays of 2.5 m and 1 m beyond; ends are 2 + 1.1 m apart.
    assert network.lengths_m[0, 1] == pytest.approx(3.5)
    assert network.lengths_m[0, 3] == network.lengths_m[5, 2] == pytest.approx(3.1)
    assert set(aisles.doors) == {1, 4}
    assert set(aisles.loads) == {(a, b) for a, b in network.lengths_m if {a, b} & {1, 4}}
    for slot in aisles.doors.values():
        assert 1.6 < 2 * slot.half[1] < 2.0
        assert abs(np.cos(slot.yaw_rad)) == pytest.approx(1.0)


@pytest.mark.slow
def test_rover_takes_as_long_as_the_model_predicts():
    drives = {d.strategy: d for d in drive_layout(OPTIONS, 0)}
    assert {d.outcome for d in drives.values()} == {"success"}
    for drive in drives.values():
        if drive.passed == drive.predicted:
            assert 0.9 < drive.measured_s / drive.predicted_s < 1.25
        assert drive.measured_s > 0.9 * drive.free_s
        assert (drive.trace[0] != drive.trace[-1]).any()
    assert drives["static + clearing"].measured_s <= drives["static"].measured_s + 0.2


def test_aisle_network_refuses_other_scenes(tmp_path):
    file = str(write_yard(tmp_path))
    with pytest.raises(SettingsError, match="has no aisles; valid: warehouse"):
        build_aisle_network(NavSettings(scene=file).build(0), 0.5)
    done = driftyard("route", "--rover", "yard.xml", "--map", "m.json", "--out", "o", cwd=tmp_path)
    assert (done.returncode, "leave --map out" in done.stderr) == (2, True)
