"""`driftyard score` on trajectories in the body frame: a remark, and the option that converts."""

import json

import numpy as np
import pytest
from folders import BASELINE_M, PERIOD_NS, wall, write_euroc
from terminal import driftyard

T_BODY_LEFT = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])


def test_score_of_body_poses_brings_a_remark_and_an_option(tmp_path):
    right = np.eye(4)
    right[0, 3] = BASELINE_M
    T_body_cams = (T_BODY_LEFT, T_BODY_LEFT @ right)
    write_euroc(tmp_path / "d", wall(4), T_body_cams=T_body_cams, truth_step_m=0.1)
    rows = (f"{(i + 1) * PERIOD_NS / 1e9} {0.1 * i} 0 0 0 0 0 1\n" for i in range(4))
    (tmp_path / "x.txt").write_text("".join(rows))
    plain = driftyard("score", "d", "x.txt", cwd=tmp_path)
    assert plain.returncode == 0
    remark = "driftyard: remark: x.txt: its poses fit those of the body; use --frame body\n"
    assert plain.stderr == remark
    body = driftyard("score", "d", "x.txt", "--frame", "body", "--json", cwd=tmp_path)
    assert body.stderr == ""
    (score,) = json.loads(body.stdout)
    assert score["ate_m"]["first_pose"]["rmse"] == pytest.approx(0, abs=1e-9)
    assert (score["frames"], score["compared"], score["statuses"]) == (4, 4, {})
