"""What the bench counts, on a world that is drawn in no time."""

import pytest

from trials.bench import length_table
from trials.speed.length import measure_lengths
from trials.speed.trial import Trial

pytestmark = pytest.mark.gl

YARD = """<mujoco><worldbody><light pos="0 0 4"/>
<geom type="plane" size="5 5 1" rgba="0.6 0.5 0.4 1"/></worldbody></mujoco>"""


def test_a_long_drive_is_compared_with_a_short_one_frame_by_frame(tmp_path):
    (tmp_path / "yard.xml").write_text(YARD)
    short, long = (Trial(str(tmp_path / "yard.xml"), 0, x) for x in (0.3, 1.2))
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
