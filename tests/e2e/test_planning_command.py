"""Static against dynamic planning: ideal depth, floor plans, and the option of `drive`."""

import json

import numpy as np
import pytest
from gym_worlds import write_yard
from terminal import driftyard

from sim.batch import build
from sim.world.world import build_world
from trials.gym.env.settings import NavSettings
from trials.gym.studies.planning import SETTINGS, floor_plan, parse_planning, ray_disparity
from trials.gym.world.free_space import map_free_space
from vo.contract.errors import SettingsError
from vo.contract.settings import amended


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    file = str(write_yard(tmp_path_factory.mktemp("yard")))
    route = {"drive.waypoints": ((-2.0, 0.0), (-1.0, 0.0)), "drive.distance_m": None}
    settings = amended(NavSettings(scene=file).recorded(0), route)
    return build_world(build(file, settings), settings)


def test_ray_disparity_ends_on_an_obstacle(world):
    disparity = ray_disparity(world)
    rig, (height, width) = world.rig, disparity.shape
    rows, columns = np.nonzero(disparity > 0)
    assert len(rows) > 0.6 * disparity.size
    z = rig.f_px * rig.baseline_m / disparity[rows, columns]
    u = (columns + 0.5) * rig.width_px / width - 0.5
    v = (rows + 0.5) * rig.height_px / height - 0.5
    points_cam = np.stack([(u - rig.cx_px) * z / rig.f_px, (v - rig.cy_px) * z / rig.f_px, z], 1)
    points = points_cam @ world.T_world_cam[:3, :3].T + world.T_world_cam[:3, 3]
    ground = np.abs(points[:, 2]) < 1e-3
    wall = np.abs(np.abs(points[:, :2]).max(axis=1) - 3.0) < 1e-3
    pillar = np.abs(np.hypot(*points[:, :2].T) - 0.3) < 1e-3
    assert (ground | wall | pillar).mean() > 0.98  # a few meet the mat
    assert min(ground.sum(), wall.sum(), pillar.sum()) > 50


def test_floor_plan_holds_the_static_obstacles(world):
    plan = floor_plan(map_free_space(world, 0.5), SETTINGS)
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-2.7, 2.7, (300, 2)):
        away_m = np.hypot(x, y) - 0.3
        if abs(away_m) > 0.12:
            assert (plan.log_odds[plan.cell(x, y)] > 0) == (away_m < 0)
    assert plan.log_odds[plan.cell(3.05, 0.0)] > 0


def test_parse_planning_refuses_unknown_words():
    assert parse_planning("dynamic, static") == ["dynamic", "static"]
    for text in ("lazy", "", "static,lazy"):
        with pytest.raises(SettingsError, match="valid: static, dynamic"):
            parse_planning(text)


def test_drive_compares_static_and_dynamic_planning(tmp_path, in_this_process):
    write_yard(tmp_path)
    words = ("--planning", "static,dynamic", "--ideal-depth", "--localization", "truth")
    short = ("--trial", "distance_m=[2.0, 4.0]", "--trial", "dynamics=doors", "--worlds", 1)
    done = driftyard("drive", "yard.xml", *words, *short, "--out", "t.jsonl", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for word in ("success", "SPL", "plans", "expanded cells", "planning, CPU ms"):
        assert word in done.stdout
    static, dynamic = (json.loads(x) for x in (tmp_path / "t.jsonl").read_text().splitlines())
    assert (static["planning"], dynamic["planning"]) == ("static", "dynamic")
    assert static["way_m"] == dynamic["way_m"]
    assert static["outcome"] == dynamic["outcome"] == "success"
    assert static["plans"] == 1
    assert 0.5 * 5 * dynamic["time_s"] < dynamic["plans"] <= 5 * dynamic["time_s"] + 1
    assert 0 < static["expanded"] <= dynamic["expanded"]  # equal: no door was in the way


def test_drive_refuses_contradicting_options_in_one_line(tmp_path):
    write_yard(tmp_path)
    for words, said in (
        (("--planning", "lazy"), "unknown planning lazy"),
        (("--planning", "static", "--keep", "k"), "neither --keep nor --figure"),
        (("--planning", "static", "--trial", "dynamics=lifts"), "unknown dynamics lifts"),
    ):
        done = driftyard("drive", "yard.xml", *words, cwd=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert said in done.stderr
