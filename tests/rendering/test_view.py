"""Files of the viewer, read back by Rerun's own reader, against truth and run."""

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from folders import write_euroc
from gym_worlds import write_yard
from terminal import driftyard

import driftyard as dy
from vo.contract.remarks import Remark

pytest.importorskip("rerun", reason="the viewer is not installed")
pytestmark = pytest.mark.gl

SMALL = {
    "rig": {"width_px": 160, "height_px": 120, "rate_hz": 5},
    "drive": {"distance_m": 1.2, "speed_mps": 0.36},
    "render": {"samples": 0, "shadow_size_px": 512},
}


@dataclass(frozen=True)
class Logged:
    """Entity to component to {frame: value}; frame None for what has no time. Times in ns."""

    values: dict[str, dict[str, dict[Any, Any]]]
    times_ns: dict[str, dict[int, int]]

    def at(self, entity: str, component: str) -> dict[Any, Any]:
        return self.values[entity][component]


def read(file: Path) -> Logged:
    from rerun.chunk import RrdReader

    reader = RrdReader(file)
    assert len(reader.recordings()) == len(reader.blueprints()) == 1
    values: Any = defaultdict(lambda: defaultdict(dict))
    times: Any = defaultdict(dict)
    for chunk in reader.store().stream():
        batch, entity = chunk.to_record_batch(), chunk.entity_path
        columns = dict(zip(batch.schema.names, batch.columns, strict=True))
        frames = columns["frame"].to_pylist() if "frame" in columns else [None] * len(batch)
        assert chunk.is_static or set(chunk.timeline_names) == {"frame", "sensor_time"}
        if "sensor_time" in columns:
            ns = columns["sensor_time"].cast("int64").to_pylist()
            times[entity] |= dict(zip(frames, ns, strict=True))
        for name, column in columns.items():
            if ":" in name:
                rows = column.to_pylist()
                found = {f: x for f, x in zip(frames, rows, strict=True) if x is not None}
                values[entity][name.split(":")[-1]] |= found
    return Logged(values, times)


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("view")
    write_yard(folder)
    dy.record(folder / "yard.xml", folder / "ds", settings=SMALL)
    dy.run(folder / "ds", out=folder / "run.txt", view=folder / "live.rrd")
    dy.view(folder / "ds", folder / "run.txt", folder / "view.rrd")
    return folder


@pytest.fixture(scope="module")
def ds(place) -> dy.Dataset:
    return dy.open(place / "ds")


@pytest.fixture(scope="module")
def run(place) -> dy.Run:
    return dy.open_run(place / "run.txt")


@pytest.fixture(scope="module")
def logged(place) -> Logged:
    return read(place / "view.rrd")


def poses_of(logged: Logged, entity: str) -> dict[int, np.ndarray]:
    R, t = logged.at(entity, "mat3x3"), logged.at(entity, "translation")
    poses = {}
    for frame in t:
        poses[frame] = np.eye(4)
        poses[frame][:3, :3] = np.reshape(R[frame], (3, 3)).T  # Rerun's matrices go by columns
        poses[frame][:3, 3] = np.ravel(t[frame])
    return poses


def test_poses_and_times_are_those_of_truth_and_run(logged, ds, run):
    bodies = poses_of(logged, "/world/carrier")
    T_body_cam = poses_of(logged, "/world/carrier/left")[None]
    assert T_body_cam == pytest.approx(ds.rig.T_body_cam, abs=1e-6)
    assert len(bodies) == len(ds)
    estimated = poses_of(logged, "/world/runs/driftyard/cameras")
    aligned = ds.T_world_cam[0] @ np.linalg.inv(run.T_odom_cam[0])
    for i, T in enumerate(ds.T_world_cam):
        assert bodies[i] @ T_body_cam == pytest.approx(T, abs=1e-5)
        assert estimated[i] == pytest.approx(aligned @ run.T_odom_cam[i], abs=1e-5)
    assert list(logged.times_ns["/world/carrier"].values()) == ds.timestamps_ns.tolist()
    right = poses_of(logged, "/world/carrier/right")[None]
    baseline = np.linalg.inv(T_body_cam) @ right
    assert baseline[:3, 3] == pytest.approx([ds.rig.baseline_m, 0, 0], abs=1e-6)


def test_path_grows_by_the_steps_between_frames(logged, ds):
    steps = logged.at("/world/truth/path", "strips")
    ends = [np.array(steps[i][0]) for i in range(len(ds))]
    for i in range(1, len(ds)):
        assert ends[i] == pytest.approx(ds.T_world_cam[[i - 1, i], :3, 3], abs=1e-5)
    (whole,) = logged.at("/world/truth/whole", "strips")[None]
    assert np.array(whole) == pytest.approx(ds.T_world_cam[:, :3, 3], abs=1e-5)


def test_images_and_depth_are_those_of_the_recording(logged, ds):
    for i, frame in enumerate(ds):
        for side, image in (("left", frame.left), ("right", frame.right)):
            blob = np.array(logged.at(f"/world/carrier/{side}/image", "blob")[i][0], np.uint8)
            shown = cv2.imdecode(blob, cv2.IMREAD_UNCHANGED)
            assert np.abs(shown.astype(int) - image).mean() < 3
        blob = np.array(logged.at("/world/carrier/left/depth", "blob")[i][0], np.uint8)
        shown_m = cv2.imdecode(blob, cv2.IMREAD_UNCHANGED) / 1000
        known = np.isfinite(ds.depth(i))
        assert (shown_m[~known] == 0).all()
        assert np.abs(shown_m - ds.depth(i))[known].max() < 5.1e-4
    meter = logged.at("/world/carrier/left/depth", "meter")
    assert meter[0] == [1000.0]


def test_pinhole_counts_pixels_from_their_corner(logged, ds):
    K = np.reshape(logged.at("/world/carrier/left", "image_from_camera")[None], (3, 3)).T
    assert K[0, 0] == pytest.approx(ds.rig.f_px)
    assert K[:2, 2] == pytest.approx([ds.rig.cx_px + 0.5, ds.rig.cy_px + 0.5])
    assert logged.at("/world/carrier/left", "resolution")[None] == [[160.0, 120.0]]


def test_features_and_tracks_are_the_observations(logged, run):
    tracks = run.tracks
    left = logged.at("/world/carrier/left/features/driftyard", "positions")
    right = logged.at("/world/carrier/right/features/driftyard", "positions")
    lines = logged.at("/world/carrier/left/tracks/driftyard", "strips")
    seen = np.unique(tracks.frame).tolist()
    assert list(left) == list(right) == list(lines) == seen
    for i in seen:
        here = tracks.frame == i
        pixels, disparity = tracks.pixels[here], tracks.disparity_px[here]
        assert np.array(left[i]).reshape(-1, 2) == pytest.approx(pixels + 0.5, abs=1e-3)
        known = np.isfinite(disparity)
        assert np.reshape(right[i], (-1, 2))[:, 0] == pytest.approx(
            (pixels[:, 0] - disparity)[known] + 0.5
        )
        assert len(lines[i]) == tracks.inlier[here].sum()
    last = seen[-1]
    ends = tracks.pixels[(tracks.frame == last) & tracks.inlier] + 0.5
    assert np.array([x[-1] for x in lines[last]]) == pytest.approx(ends, abs=1e-3)
    assert max(map(len, lines[last])) > 2


def test_errors_and_map_are_those_of_score_and_run(logged, ds, run):
    score = dy.score(ds, run)
    drift = logged.at("/plots/drift_pct/driftyard", "scalars")
    assert np.mean(list(drift.values())) == pytest.approx(score.drift_pct)
    errors = logged.at("/plots/translation_error_m/driftyard", "scalars")
    assert errors[len(ds) - 1] == pytest.approx([score.end_m])
    assert len(errors) == len(logged.at("/plots/rotation_error_deg/driftyard", "scalars"))
    inliers = logged.at("/plots/inliers/driftyard", "scalars")
    here = run.tracks.frame == 3
    assert inliers[3] == [float(run.tracks.inlier[here].sum())]
    points = logged.at("/world/runs/driftyard/map", "positions")
    T_world_odom = ds.T_world_cam[0] @ np.linalg.inv(run.T_odom_cam[0])
    expected = run.map.points_odom @ T_world_odom[:3, :3].T + T_world_odom[:3, 3]
    shown = np.concatenate([np.array(x) for x in points.values()])
    assert shown.shape == expected.shape
    order, same = np.lexsort(shown.T.round(3)), np.lexsort(expected.T.round(3))
    assert np.abs(shown[order].sum(axis=0) - expected[same].sum(axis=0)).max() < 1e-2
    assert len(points) > 1  # it grows


def test_ellipsoid_is_that_of_the_covariance(logged, run):
    (name,) = [x for x in logged.values if "covariance" in x]
    factor = float(name.rpartition("_x")[2])
    with np.load(run.path.with_name("run.covariance.npz")) as file:
        P = file["pose"][-1][:3, :3]
    half = np.ravel(logged.at(name, "half_sizes")[len(run.frames) - 1])
    assert half == pytest.approx(3 * factor * np.sqrt(np.linalg.eigvalsh(P)), rel=1e-4)
    assert name.endswith(f"covariance_3_sigma_x{factor:g}")


def test_status_log_and_sensors_are_there(logged, ds, run):
    states = logged.at("/status/driftyard", "state")
    status = [x.value for x in run.frames.status]
    changes = [i for i in range(len(status)) if i == 0 or status[i] != status[i - 1]]
    assert {i: x for i, (x,) in states.items()} == {i: status[i] for i in changes}
    assert logged.at("/log/driftyard", "text")[0] == ["frame 0: start"]
    gyro = logged.values["/sensors/gyro_radps"]["scalars"]
    assert set(gyro) <= set(range(len(ds)))
    assert len(next(iter(gyro.values()))) == 3
    ticks = logged.at("/sensors/wheel_ticks", "scalars")
    assert ticks[len(ds) - 1] == [float(x) for x in ds[-1].wheel_ticks]


def test_scene_is_the_world_of_the_recording(logged):
    corners = [
        np.array(of["vertex_positions"][None])
        for entity, of in logged.values.items()
        if entity.startswith("/world/scene/") and "vertex_positions" in of
    ]
    low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
    assert low == pytest.approx([-6, -6, 0], abs=1e-6)
    assert high == pytest.approx([6, 6, 1.6], abs=1e-6)
    rover = np.array(logged.at("/world/carrier/model/0", "vertex_positions")[None])
    assert 0.2 < np.ptp(rover, axis=0).max() < 0.7


def test_live_view_shows_what_the_view_of_the_run_does(place, logged):
    live = read(place / "live.rrd")
    for entity in ("/world/carrier", "/world/runs/driftyard/cameras"):
        poses, expected = poses_of(live, entity), poses_of(logged, entity)
        assert list(poses) == list(expected)
        assert np.array(list(poses.values())) == pytest.approx(
            np.array(list(expected.values())), abs=1e-5
        )
    for kind in ("translation_error_m", "rotation_error_deg", "drift_pct", "inliers"):
        entity = f"/plots/{kind}/driftyard"
        assert live.at(entity, "scalars").keys() == logged.at(entity, "scalars").keys()
        values = [list(x.at(entity, "scalars").values()) for x in (live, logged)]
        assert np.array(values[0]) == pytest.approx(np.array(values[1]), abs=1e-5)
    entity = "/world/carrier/left/features/driftyard"
    assert live.at(entity, "positions").keys() == logged.at(entity, "positions").keys()


def test_selected_frames_keep_their_numbers(place, ds, tmp_path):
    some = dy.open(place / "ds", first=2, every=3)
    dy.view(some, [place / "run.txt", place / "run.txt"], tmp_path / "some.rrd")
    found = read(tmp_path / "some.rrd")
    numbers = list(range(2, len(ds), 3))
    assert list(found.at("/world/carrier", "translation")) == numbers
    plots = [x for x in found.values if x.startswith("/plots/inliers/")]
    assert len(plots) == 2
    assert [list(found.at(x, "scalars")) for x in plots] == [numbers, numbers]


def test_recording_without_truth_is_shown_by_its_run(tmp_path):
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (3, 48, 64), dtype=np.uint8)
    K = np.array([[50.0, 0, 31.5], [0, 50.0, 23.5], [0, 0, 1]])
    folder = write_euroc(tmp_path / "ds", [(x, np.roll(x, -4, axis=1)) for x in images], K)
    lines = [f"{(i + 1) / 10:.1f} {i} 0 0 0 0 0 1" for i in range(3)]
    (tmp_path / "other.txt").write_text("\n".join(lines))
    (folder / "mav0/cam0/data/200000000.png").write_bytes(b"\x89PNG")
    with pytest.warns(Remark, match="1 of 3 frames are shown without images"):
        dy.view(folder, tmp_path / "other.txt", tmp_path / "a.rrd")
    found = read(tmp_path / "a.rrd")
    assert [x[0][0] for x in found.at("/world/carrier", "translation").values()] == [0, 1, 2]
    assert list(found.at("/world/carrier/left/image", "blob")) == [0, 2]
    assert not [x for x in found.values if x.startswith(("/world/scene", "/status"))]
    assert not [x for x, of in found.values.items() if "scalars" in of]


def test_failure_leaves_no_file(tmp_path, place):
    (tmp_path / "bad.txt").write_text("1.0 0 0 0\n")
    with pytest.raises(dy.TrajectoryError):
        dy.view(place / "ds", tmp_path / "bad.txt", tmp_path / "a.rrd")

    class Stopped:
        def __init__(self, rig):
            pass

        def track(self, frame):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        dy.run(place / "ds", Stopped, tmp_path / "run.txt", view=tmp_path / "a.rrd")
    assert sorted(x.name for x in tmp_path.iterdir()) == ["bad.txt"]


def test_commands_write_files(place, tmp_path):
    done = driftyard("view", place / "ds", place / "run.txt", "--save", "a.rrd", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "a.rrd: open it with `rerun a.rrd`\n")
    assert "/world/runs/driftyard/cameras" in read(tmp_path / "a.rrd").values
    words = ("--estimator", "corner_flow", "--out", "b.txt", "--save", "b.rrd", "--last", "2")
    assert driftyard("run", place / "ds", *words, cwd=tmp_path).returncode == 0
    assert len(read(tmp_path / "b.rrd").at("/world/carrier", "translation")) == 3


def test_driven_trials_are_shown_and_stay_the_same(tmp_path):
    write_yard(tmp_path)
    words = ("--localization", "drift:20", "--worlds", 1, "--trial", "distance_m=[1.0, 1.2]")
    words = (*words, "--trial", "rate_hz=5.0", "--set", "rig.width_px=160")
    words = ("drive", "yard.xml", *words, "--set", "rig.height_px=120")
    done = driftyard(*words, "--out", "a.jsonl", "--save", "shown", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert driftyard(*words, "--out", "b.jsonl", cwd=tmp_path).returncode == 0
    assert (tmp_path / "a.jsonl").read_text() == (tmp_path / "b.jsonl").read_text()
    (trial,) = [json.loads(x) for x in (tmp_path / "a.jsonl").read_text().splitlines()]
    found = read(tmp_path / "shown/0-0-drift_20.rrd")
    errors = found.at(r"/plots/translation_error_m/drift\:20", "scalars")
    assert errors[max(errors)] == [trial["error_m"]]
    assert len(found.at("/world/carrier/left/image", "blob")) == len(errors)
    assert found.at("/log/outcome", "text")[max(errors)] == [trial["outcome"]]
    refused = driftyard(*words, "--planning", "static", "--save", "shown", cwd=tmp_path)
    assert "nor a viewer" in refused.stderr
