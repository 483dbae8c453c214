"""What views show of worlds and runs, without the viewer."""

import importlib.util
import socket

import mujoco
import numpy as np
import pytest

from trials.cli.options import LiveViewOptions, ViewerOptions
from trials.evaluation.alignment import Alignment
from trials.evaluation.metrics import position_errors
from trials.evaluation.runs import FrameTable, SavedRun, Tracks
from trials.evaluation.score import score_run
from trials.view.meshes import drawn_geoms, geom_meshes
from trials.view.run_rows import align_first_pose, align_runs
from trials.view.target import EXAMPLE, target_of
from vo.contract import se3
from vo.contract.errors import SettingsError
from vo.contract.estimator import Status
from vo.contract.remarks import Remark
from vo.contract.trajectory import Trajectory

N, PERIOD_NS = 60, 100_000_000
TIMES = np.arange(1, N + 1) * PERIOD_NS
HAS_VIEWER = importlib.util.find_spec("rerun_bindings") is not None


def model_of(body: str, assets: str = "") -> mujoco.MjModel:
    xml = f"<mujoco><asset>{assets}</asset><worldbody>{body}</worldbody></mujoco>"
    return mujoco.MjModel.from_xml_string(xml)


def meshes_of(model: mujoco.MjModel, T: np.ndarray | None = None) -> list:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return geom_meshes(model, data, drawn_geoms(model), np.eye(4) if T is None else T)


@pytest.mark.parametrize(
    ("geom", "volume_m3"),
    [
        ('type="box" size=".1 .2 .3"', 8 * 0.006),
        ('type="sphere" size=".5"', 4 / 3 * np.pi * 0.125),
        ('type="ellipsoid" size=".5 .4 .3"', 4 / 3 * np.pi * 0.06),
        ('type="cylinder" size=".2 .5"', np.pi * 0.04),
        ('type="capsule" size=".2 .5"', np.pi * 0.04 + 4 / 3 * np.pi * 0.008),
    ],
)
def test_triangles_of_a_solid_enclose_its_volume(geom, volume_m3):
    (mesh,) = meshes_of(model_of(f'<geom {geom} pos="1 2 3" euler="20 30 40" rgba="1 0 0 1"/>'))
    a, b, c = np.moveaxis(mesh.corners - [1, 2, 3], 1, 0)
    signed = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6  # positive of faces that look outwards
    assert (signed > -1e-12).all()
    assert 0.9 * volume_m3 < signed.sum() <= volume_m3 * (1 + 1e-9)
    assert mesh.colours[:, 0].max() > 200
    assert (mesh.colours[:, 1:] == 0).all()


def test_triangles_follow_frame_plane_and_height_field():
    field = '<hfield name="h" nrow="3" ncol="3" size="1 1 .5 .1" elevation="0 0 0 0 1 0 0 0 0"/>'
    geoms = '<geom type="hfield" hfield="h"/><geom type="plane" size="2 3 1"/>'
    (mesh,) = meshes_of(model_of(geoms, field), se3.pose(np.eye(3), np.array([0, 0, 10.0])))
    assert mesh.corners[..., 2].max() == pytest.approx(10.5)
    assert mesh.corners.reshape(-1, 3).min(axis=0) == pytest.approx([-2, -3, 10])


def test_texture_of_a_mesh_keeps_its_place():
    assets = (
        '<texture name="t" type="2d" builtin="checker" width="1024" height="512" rgb1="1 0 0" '
        'rgb2="0 0 1"/><material name="m" texture="t"/><mesh name="q" '
        'vertex="0 0 0  1 0 0  0 1 0  0 0 1" face="0 2 1  0 1 3  1 2 3  0 3 2" '
        'texcoord="0 0  .5 0  0 .25  1 1"/>'
    )
    model = model_of('<geom type="mesh" mesh="q" material="m"/>', assets)
    (mesh,) = meshes_of(model)
    assert mesh.texture.shape == (128, 256, 3)
    assert set(map(tuple, mesh.texture.reshape(-1, 3).tolist())) == {(255, 0, 0), (0, 0, 255)}
    found = mesh.corners.reshape(-1, 3) - mesh.corners.min(axis=(0, 1))
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    assert found.shape == (12, 3)
    place = model.mesh_texcoord  # as MuJoCo draws it, v turned upside down
    for corner, texcoord in zip(found, mesh.texcoords.reshape(-1, 2), strict=True):
        k = int(np.argmin(np.linalg.norm(corners - corner, axis=1)))
        assert texcoord == pytest.approx(place[k], abs=1e-6)


def test_geoms_that_images_do_not_show_are_left_out():
    hidden = '<geom size="1" group="3"/><geom size="1" group="4"/><geom size="1" rgba="1 1 1 0"/>'
    assert len(drawn_geoms(model_of(hidden))) == 0


def truth() -> Trajectory:
    yaw = np.linspace(0, 1, N)
    T = se3.exp(np.stack([0 * yaw, 0 * yaw, 0 * yaw, 0 * yaw, 0 * yaw, yaw], axis=-1))
    T[:, 0, 3], T[:, 1, 3] = 0.08 * np.arange(N), 0.3 * np.sin(yaw)
    return Trajectory(TIMES, T)


def run_of(trajectory: Trajectory, path, frames: bool = True, lost: int = -1) -> SavedRun:
    status = [Status.LOST if i == lost else Status.TRACKED for i in range(N)]
    times, T = trajectory.timestamps_ns, trajectory.T_ref_frame
    kept = times != (TIMES[lost] if lost >= 0 else -1)
    table = FrameTable(
        TIMES, tuple(status), tuple("dark" * (i == lost) for i in range(N)), np.ones(N), {}, {}
    )
    frame = np.repeat(np.arange(N), 2)
    seen = np.tile([7, 8], N)
    pixels = np.column_stack([frame, seen]).astype(float)
    tracks = Tracks(seen, frame, pixels, np.full(2 * N, 4.0), seen == 7)
    kept_path = Trajectory(times[kept], T[kept])
    return SavedRun(path, "mine", kept_path, table if frames else None, tracks if frames else None)


def drifting(scale: float = 1.02) -> Trajectory:
    T = truth().T_ref_frame.copy()
    T[:, :3, 3] *= scale
    T_odom_world = se3.exp(np.array([3.0, -2, 1, 0.3, 0.2, -2]))
    return Trajectory(TIMES, T_odom_world @ T)


def test_rows_have_the_errors_of_the_score(tmp_path):
    run = run_of(drifting(), tmp_path / "run.txt")
    (aligned,) = align_runs(truth(), [run])
    rows = list(aligned.rows(TIMES, np.arange(N)))
    score = score_run(truth(), run, N)
    assert rows[-1].translation_error_m == pytest.approx(score.end_m)
    assert np.nanmean([x.drift_pct for x in rows]) == pytest.approx(score.drift_pct)
    expected = position_errors(aligned.pair, Alignment.FIRST_POSE)
    assert [x.translation_error_m for x in rows] == pytest.approx(expected)
    assert max(x.rotation_error_deg for x in rows) < 1e-5
    assert rows[0].T_world_cam == pytest.approx(truth().T_ref_frame[0])
    assert [x.inliers for x in rows] == [1.0] * N
    assert rows[5].estimate.observations.pixels.tolist() == [[5.0, 7.0], [5.0, 8.0]]


def test_alignment_of_a_live_view_makes_first_poses_equal():
    T_world_cam, T_odom_cam = se3.exp(np.array([[1.0, 2, 3, 0.4, 0.5, 0.6], [3, 1, 2, 1, 0, -1]]))
    aligned = align_first_pose(T_world_cam, T_odom_cam)
    assert aligned.map(T_odom_cam[None])[0] == pytest.approx(T_world_cam)


def test_rows_of_selected_frames_are_theirs(tmp_path):
    run = run_of(drifting(), tmp_path / "run.txt", lost=10)
    (aligned,) = align_runs(truth(), [run])
    rows = list(aligned.rows(TIMES[::5], np.arange(N)[::5]))
    assert [x.frame for x in rows] == list(range(0, N, 5))
    assert rows[2].T_world_cam is None
    assert (rows[2].estimate.status, rows[2].estimate.reason) == (Status.LOST, "dark")
    assert rows[3].estimate.timestamp_ns == TIMES[15]


def test_runs_without_truth_are_aligned_to_the_first(tmp_path):
    first, second = truth(), drifting(1.0)
    runs = [run_of(x, tmp_path / "run.txt", frames=False) for x in (first, second)]
    rows = [list(x.rows(TIMES, np.arange(N))) for x in align_runs(None, runs)]
    assert rows[1][-1].T_world_cam == pytest.approx(rows[0][-1].T_world_cam)
    assert np.isnan(rows[1][-1].translation_error_m)
    assert np.isnan(rows[0][0].inliers)


def test_run_of_other_times_is_shown_unaligned_with_a_remark(tmp_path):
    later = Trajectory(TIMES + 10**12, drifting().T_ref_frame)
    run = run_of(later, tmp_path / "run.txt", frames=False)
    with pytest.warns(Remark, match="without alignment: the estimate shares 0 times"):
        (aligned,) = align_runs(truth(), [run])
    assert list(aligned.rows(TIMES, np.arange(N))) == []


@pytest.mark.skipif(HAS_VIEWER, reason="the viewer is installed")
def test_missing_package_is_named():
    with pytest.raises(SettingsError, match=r'pip install "driftyard\[view\]"'):
        target_of("run.rrd")


@pytest.mark.skipif(not HAS_VIEWER, reason="the viewer is not installed")
@pytest.mark.parametrize(
    ("to", "message"),
    [
        ("run.mp4", r"run\.mp4: the name must end in \.rrd"),
        ("http://127.0.0.1:9876", "expected the address of a viewer, as rerun"),
        ("rerun+http://127.0.0.1:99999/proxy", "no viewer listens there"),
        (None, "no display for the viewer: write a file with --save FILE.rrd"),
    ],
)
def test_unusable_targets_are_refused(to, message, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(SettingsError, match=message):
        target_of(to)


@pytest.mark.skipif(not HAS_VIEWER, reason="the viewer is not installed")
def test_listening_address_is_a_target():
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = EXAMPLE.replace("9876", str(server.getsockname()[1]))
        assert target_of(url).url == url


def test_view_options_agree(tmp_path):
    assert LiveViewOptions().live is False
    assert LiveViewOptions(view=True).live is True
    assert LiveViewOptions(save=tmp_path / "a.rrd").live == tmp_path / "a.rrd"
    with pytest.raises(SettingsError, match="one of both"):
        _ = ViewerOptions(tmp_path / "a.rrd", EXAMPLE).to
    with pytest.raises(SettingsError, match="--connect 9876"):
        _ = ViewerOptions(connect="9876").to
