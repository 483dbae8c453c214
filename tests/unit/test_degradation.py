"""Disturbances on recordings: known noise, blur, motion, gain and calibration; truth stays."""

import warnings

import cv2
import numpy as np
import pytest
from folders import DISPARITY_PX, HEIGHT, WIDTH, wall, write_euroc
from terminal import driftyard

import driftyard as dy
from sim.disturbances import DISTURBANCES
from sim.imaging.linear_light import decode
from trials.realism.degradation import applicable, move
from trials.realism.stereo_range import _filled
from vo.contract.remarks import Remark

STEP_PX = 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("degrade")
    write_euroc(place / "wall", wall(3, STEP_PX), truth_step_m=0.05)
    return place


def test_only_disturbances_of_the_images_apply():
    lens_and_sensor = {"noise", "defocus", "drop", "stereo_mismatch", "miscalibration"}
    assert lens_and_sensor | {"blur", "rolling_shutter", "stereo_offset"} <= set(applicable())
    assert "fog" in applicable()
    assert not {"rain", "slip", "load", "sill", "brick_bump", "collision"} & set(applicable())
    assert set(applicable()) <= set(DISTURBANCES)


def test_noise_has_the_variance_of_the_simulated_sensor(folder):
    real = dy.open(folder / "wall")
    noisy = dy.degrade(real, "noise=0.5", folder / "noisy")
    light, clean = decode(noisy[0].left), decode(real[0].left)
    inner = (clean > 0.2) & (clean < 0.6)
    well = 500 / 0.5**2
    expected = clean[inner] / well + (0.03 * 0.5) ** 2
    assert np.mean((light - clean)[inner] ** 2) == pytest.approx(expected.mean(), rel=0.1)
    again = dy.degrade(real, "noise=0.5", folder / "again")
    assert np.array_equal(again[2].right, noisy[2].right)
    assert not np.array_equal(noisy[0].left, noisy[1].left)


def test_defocus_is_a_gaussian_in_linear_light(folder):
    soft = dy.degrade(folder / "wall", "defocus=0.5", folder / "soft")
    light = cv2.GaussianBlur(decode(dy.open(folder / "wall")[1].left), (13, 13), 2.0)
    inner = np.s_[20:-20, 20:-20]
    assert abs(decode(soft[1].left)[inner] - light[inner]).max() < 0.01


@pytest.mark.parametrize("name", ["soiling", "chromatic"])
def test_faults_of_the_lens_change_both_images(folder, name):
    made, real = dy.degrade(folder / "wall", name, folder / name), dy.open(folder / "wall")
    for eye in ("left", "right"):
        assert abs(getattr(made[0], eye).astype(int) - getattr(real[0], eye)).max() > 20


def test_truth_is_carried_over_from_any_layout(folder):
    real = dy.open(folder / "wall")
    kitti = dy.export(real, "kitti", folder / "kitti")
    for name, source in (("a", folder / "wall"), ("b", kitti)):
        made = dy.degrade(source, "stereo_mismatch", folder / name)
        before = dy.open(source)
        assert made.T_world_cam == pytest.approx(before.T_world_cam, abs=1e-9)
        assert vars(made.rig) | {"T_body_cam": 0} == pytest.approx(
            vars(before.rig) | {"T_body_cam": 0}
        )
        assert np.array_equal(made.timestamps_ns, before.timestamps_ns)
    ratio = decode(made[0].right).mean() / decode(real[0].right).mean()
    assert ratio == pytest.approx(1 / 1.25, abs=0.03)


def test_lost_frames_and_calibration_are_those_of_the_recipe(folder):
    made = dy.degrade(folder / "wall", "drop=1.5,miscalibration=2", folder / "bad")
    real = dy.open(folder / "wall")
    assert len(made) < len(real)
    assert made.timestamps_ns[0] == real.timestamps_ns[0]
    assert made.rig.baseline_m == pytest.approx(1.01 * real.rig.baseline_m)
    assert made.rig.f_px == pytest.approx(1.01 * real.rig.f_px)


def test_late_right_eye_moves_by_the_motion_and_says_so(folder):
    """The wall moves by 4 px in 100 ms; 50 ms later, by 2 px to the left."""
    with pytest.warns(Remark, match="estimated by optical flow"):
        made = dy.degrade(folder / "wall", "stereo_offset=6.25", folder / "late")
    before = dy.open(folder / "wall")[0].right.astype(np.float32)
    inner = np.s_[20:-20, 20:-20]
    after = made[0].right.astype(np.float32)[inner]
    shifted = {d: abs(np.roll(before, -d, axis=1)[inner] - after).mean() for d in range(5)}
    assert min(shifted, key=shifted.get) == 2
    assert np.array_equal(made[0].left, dy.open(folder / "wall")[0].left)


def test_fog_follows_the_estimated_distance_and_says_so(folder):
    """The wall is at one depth: Koschmieder's law with the length of each ray, in both eyes."""
    with pytest.warns(Remark, match="distances in fog are estimated by stereo"):
        made = dy.degrade(folder / "wall", "fog", folder / "fog")
    real = dy.open(folder / "wall")
    rig = real.rig
    depth_m = rig.f_px * rig.baseline_m / DISPARITY_PX
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    ray = np.hypot(np.hypot(u - rig.cx_px, v - rig.cy_px) / rig.f_px, 1)
    passed = 0.05 ** (depth_m * ray / 10)
    inner = np.s_[20:-20, 40:-40]
    for eye in ("left", "right"):
        expected = decode(getattr(real[0], eye)) * passed + 0.6 * (1 - passed)
        off = abs(decode(getattr(made[0], eye)) - expected)[inner]
        assert np.median(off) < 0.01
        assert np.quantile(off, 0.95) < 0.03
    assert np.isnan(_filled(np.full((2, 4), np.nan))).all()
    nan = np.nan
    assert _filled(np.array([[nan, 5, nan, 3, nan]])).tolist() == [[5, 5, 3, 3, 3]]


def test_rows_move_by_their_own_share():
    light = np.tile(np.arange(20, dtype=np.float32), (4, 1))
    flow = np.zeros((4, 20, 2), np.float32)
    flow[..., 0] = 2
    moved = move(light, flow, np.array([0.0, 0.5, 1.0, -1.0]))
    assert moved[:, 10].tolist() == [10, 9, 8, 12]


def test_what_needs_the_simulator_is_refused_with_valid_names(folder):
    for words, said in (
        ("slip", "slip needs the simulator; valid on recordings: blur"),
        ("eye_mismatch", "eye_mismatch is now stereo_mismatch"),
        ("", "names no disturbance; valid"),
    ):
        done = driftyard("degrade", "wall", "--disturb", words, "--out", "x", cwd=folder)
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
        assert not (folder / "x").exists()


def test_command_writes_what_run_reads(folder):
    words = ("degrade", "wall", "--disturb", "blur", "--last", "1", "--out", "blurred")
    done = driftyard(*words, cwd=folder)
    assert done.stdout == "blurred: 2 frames\n", done.stderr
    run = driftyard("run", "blurred", "--out", "b.txt", "--estimator", "corner_flow", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert driftyard(*words, cwd=folder).returncode == 2  # it exists
    assert dy.open(folder / "blurred")[0].left.shape == (HEIGHT, WIDTH)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dy.open(folder / "blurred")
