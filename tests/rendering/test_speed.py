"""Measurements of `driftyard bench` on a world that renders fast."""

import numpy as np
import pytest
from folders import wall, write_euroc
from terminal import driftyard

from trials.execution.recording_settings import recording_settings
from trials.studies.bench import PARTS, endurance_table, length_table
from trials.studies.speed.cameras import CAMERAS, measure_cameras
from trials.studies.speed.comparison import RECORDINGS, comparison_table, measure_rounds
from trials.studies.speed.costs import IMAGES, Conditions, measure_drives
from trials.studies.speed.drive import TimedDrive
from trials.studies.speed.estimator import EstimatorSpeed, measure_estimator, to_and_fro
from trials.studies.speed.generator import measure_lengths
from trials.studies.speed.start import time_program
from vo.recordings.readers import open_sequence

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


def test_measure_cameras_times_frames_of_each(tmp_path):
    (tmp_path / "yard.xml").write_text(YARD)
    drive = "rig.width_px=64", "rig.height_px=48", "drive.distance_m=0.4", "render.samples=0"
    found = measure_cameras(str(tmp_path / "yard.xml"), 0, 1, drive=drive)
    assert found.shape == (1, len(CAMERAS), 2)
    assert (found > 0).all()


def test_endurance_table_compares_start_and_end():
    ms = np.repeat([10.0, 20.0, 40.0], [4, 32, 4])
    speed = EstimatorSpeed(ms, {}, np.linspace(1024, 2560, 40))
    (names, ours) = (list(column.cells) for column in endurance_table({"it": speed}).columns)
    rows = list(zip(names, ours, strict=True))
    assert rows[:3] == [
        ("first tenth, median, ms", "10.0"),
        ("last tenth, median, ms", "40.0"),
        ("ratio, ≤ 1.1 required", "4.00"),
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


def test_bench_unknown_part_is_refused_with_the_valid_ones(tmp_path):
    result = driftyard("bench", "--only", "speed", cwd=tmp_path)
    assert result.returncode == 2
    assert all(name in result.stderr for name in PARTS)


def test_comparison_table_holds_medians_of_rounds():
    def runs(*rounds_ms):
        return [EstimatorSpeed(np.array(x), {}, np.zeros(3)) for x in rounds_ms]

    ours = runs([10.0, 10.0, 16.0], [20.0, 20.0, 20.0], [10.0, 10.0, 16.0])
    theirs = runs([20.0, 20.0, 20.0], [20.0, 20.0, 20.0], [20.0, 20.0, 20.0])
    label = next(iter(RECORDINGS))
    table = comparison_table({label: {"driftyard": ours, "corner_flow": theirs}})
    (row,) = zip(*(column.cells for column in table.columns), strict=True)
    assert row == (label, "10.0", "20.0", "0.50", "0.60", "≤ 0.45", "1.54", "≤ 1.6")


def test_measure_rounds_runs_estimators_in_turn(tmp_path):
    speeds = measure_rounds(write_euroc(tmp_path / "wall", wall(3)), rounds=2)
    assert list(speeds) == ["driftyard", "corner_flow"]
    assert [len(x.frame_ms) for runs in speeds.values() for x in runs] == [3] * 4


def test_recordings_of_the_comparison_have_accepted_settings():
    for timed in RECORDINGS.values():
        assert recording_settings(timed.scene, 0, timed.overrides)


def test_to_and_fro_turns_at_both_ends(tmp_path):
    sequence = open_sequence(write_euroc(tmp_path / "wall", wall(3)))
    longer = to_and_fro(sequence, 8)
    order = (0, 1, 2, 1, 0, 1, 2, 1)
    assert len(longer) == len(order)
    for i, k in enumerate(order):
        np.testing.assert_array_equal(longer[i].left, sequence[k].left)


def test_time_program_counts_from_its_start_in_both_times(tmp_path):
    text = (
        "import os, sys, time\n"
        "print(time.monotonic() - float(sys.argv[1]), len(os.environ['NUMBA_CACHE_DIR']))"
    )
    timed = time_program(text, kept=tmp_path)
    ((elapsed_s, letters),) = timed.lines
    assert 0 < elapsed_s <= timed.wall_s
    assert letters == len(str(tmp_path))
    assert timed.cpu_s > 0


def test_costs_of_drives_that_differ_in_labels(tmp_path):
    """The images of a world of a plane do not depend on the labels."""
    world = tmp_path / "plane.xml"
    world.write_text(YARD)
    rows = [Conditions(str(world), (64, 48), x) for x in ((), ("depth",))]
    plain, labelled = measure_drives(rows, tmp_path)
    assert plain.kb.keys() == {IMAGES}
    assert labelled.kb.keys() == {IMAGES, "depth"}
    assert plain.kb[IMAGES] == labelled.kb[IMAGES] > 0
    assert min(plain.frame_ms, labelled.frame_ms, plain.drive_s) > 0
