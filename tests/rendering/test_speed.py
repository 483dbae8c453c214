"""Measurements of `driftyard bench` on a world that renders fast."""

import numpy as np
import pytest
from folders import wall, write_euroc
from terminal import driftyard

from trials.studies.bench import endurance_table, length_table
from trials.studies.speed.drive import TimedDrive
from trials.studies.speed.estimator import EstimatorSpeed, measure_estimator
from trials.studies.speed.generator import measure_lengths

pytestmark = pytest.mark.gl

YARD = """<mujoco><worldbody><light pos="0 0 4"/>
<geom type="plane" size="5 5 1" rgba="0.6 0.5 0.4 1"/></worldbody></mujoco>"""


def test_measure_lengths_times_frames_of_both_drives(tmp_path):
    (tmp_path / "yard.xml").write_text(YARD)
    short, long = (TimedDrive(str(tmp_path / "yard.xml"), 0, x) for x in (0.3, 0.9))
    cost = measure_lengths(short, long, 5)
    more = (long.distance_m - short.distance_m) / long.settings().drive.speed_mps
    assert cost.long.frames - cost.short.frames == pytest.approx(
        more * long.settings().rig.rate_hz, abs=2
    )
    for drive in (cost.short, cost.long):
        assert 0 < drive.physics_ms < drive.picture_ms < drive.frame_ms
        assert drive.memory_mb > 100  # of this process, with all that other tests left
    assert cost.again_ms == pytest.approx(cost.short.picture_ms, rel=0.5)
    cells = (column.cells for column in length_table(cost).columns[:2])
    rows = {str(x): str(y) for x, y in zip(*cells, strict=True)}
    assert rows["all"] == f"{cost.short.frame_ms:.1f}"


def test_endurance_table_compares_start_and_end():
    ms = np.repeat([10.0, 20.0, 40.0], [4, 32, 4])
    speed = EstimatorSpeed(ms, {}, np.linspace(1024, 2560, 40))
    (names, ours) = (list(column.cells) for column in endurance_table({"it": speed}).columns)
    rows = list(zip(names, ours, strict=True))
    assert rows[:3] == [
        ("first tenth, median, ms", "10.0"),
        ("last tenth, median, ms", "40.0"),
        ("ratio", "4.00"),
    ]
    assert rows[-2:] == [("memory after a tenth, GB", "1.12"), ("memory at the end, GB", "2.50")]


def test_measure_estimator_times_every_frame(tmp_path):
    speed = measure_estimator("corner_flow", write_euroc(tmp_path / "wall", wall(6)))
    assert len(speed.frame_ms) == len(speed.memory_mb) == 6
    assert np.all(speed.frame_ms > 0)
    assert np.all(speed.memory_mb > 50)
    assert sum(speed.stage_ms.values()) <= speed.frame_ms.mean()


def test_bench_missing_dataset_is_an_error_in_one_line(tmp_path):
    result = driftyard("bench", "--over", "nowhere", cwd=tmp_path)
    assert result.returncode == 2
    assert "nowhere" in result.stderr
    assert result.stderr.count("\n") == 1
