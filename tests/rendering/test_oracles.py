"""Oracles against labels that they do not use."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from sim.record import record
from sim.settings import (
    DriveSettings,
    LabelSettings,
    RecordSettings,
    RenderSettings,
    RigSettings,
)
from trials.diagnosis.hooks import MAX_INLIER_PX, ORACLES, Oracle
from trials.evaluation.disparity_errors import disparity_errors
from trials.evaluation.runs import FrameTable, SavedRun, Tracks
from trials.evaluation.truth import TrueWorld
from vo.contract import se3
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.estimator import Status
from vo.contract.sequence import StereoFrame
from vo.contract.trajectory import Trajectory
from vo.hooks import Hooks
from vo.recordings.images import read_codes, read_float
from vo.recordings.readers import open_sequence, read_truth

pytestmark = pytest.mark.gl

SETTINGS = RecordSettings(
    rig=RigSettings(width_px=160, height_px=120, rate_hz=10),
    drive=DriveSettings(distance_m=0.25),
    render=RenderSettings(samples=0, shadow_size_px=256),
    labels=LabelSettings(flow=True, covisibility=True),
)
FRAME = 8
"""At full speed."""
DOWN = np.array([0.0, 1.0])


@pytest.fixture(scope="module")
def dataset(make_scene, tmp_path_factory):
    out = tmp_path_factory.mktemp("oracles") / "boxes"
    record(make_scene(boxes=True), SETTINGS, out)
    return out


@pytest.fixture(scope="module")
def times(dataset):
    return open_sequence(dataset).timestamps_ns[FRAME : FRAME + 2].tolist()


@pytest.fixture(scope="module")
def grid():
    """Every pixel but the outermost."""
    v, u = np.mgrid[1:119, 1:159]
    return np.stack([u.ravel(), v.ravel()], axis=-1).astype(float)


def label(dataset, folder, time, pixels, **options):
    path = next((dataset / "mav0" / folder / "data").glob(f"{time}.*"))
    image = read_codes(path) if path.suffix == ".png" else read_float(path, **options)
    u, v = pixels.astype(int).T
    return image[v, u]


def frame_at(time):
    blank = np.zeros((120, 160), np.uint8)
    return StereoFrame(time, blank, blank)


def test_disparity_at_pixels_is_the_label(dataset, times, grid):
    found = TrueWorld(dataset).disparity(times[0], grid)
    expected = label(dataset, "disparity0", times[0], grid)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_disparity_between_pixels_of_a_plane_is_exact(dataset, times):
    """The ground at z = 0, seen from a known pose."""
    world = TrueWorld(dataset)
    pixels = np.random.default_rng(0).uniform([5, 60], [150, 115], (400, 2))
    points = world.points_world(times[0], pixels)
    ground = np.abs(points[:, 2]) < 0.01
    assert ground.mean() > 0.5
    assert np.quantile(np.abs(points[ground, 2]), 0.97) < 1e-6  # the rest touches a box
    np.testing.assert_allclose(world.project(times[0], points), pixels, atol=1e-9)


def test_disparity_outside_the_image_is_nan(dataset, times):
    pixels = np.array([[-0.1, 50.0], [50.0, 119.1], [np.nan, 3.0], [159.0, 119.0]])
    known = ~np.isnan(TrueWorld(dataset).disparity(times[0], pixels))
    assert known.tolist() == [False, False, False, True]


def test_disparity_errors_are_those_put_in(dataset, times, grid):
    """Every tenth disparity of inliers is wrong by 1 px, the others by 0.1; outliers by more."""
    true = np.concatenate([TrueWorld(dataset).disparity(x, grid) for x in times])
    n, row = len(true), np.arange(len(true))
    inlier = row % 2 == 0
    wrong = np.where(inlier, np.where(row % 20 == 0, 1.0, 0.1), 9.0)
    frame = np.repeat([0, 1], n // 2)
    tracks = Tracks(row, frame, np.concatenate([grid, grid]), true + wrong, inlier)
    table = FrameTable(np.array(times), (Status.TRACKED,) * 2, ("", ""), np.ones(2), {}, {})
    empty = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)))
    found = disparity_errors(dataset, SavedRun(dataset, "x", empty, table, tracks))
    assert found.observations == (inlier & np.isfinite(true)).sum()
    assert found.median_px == pytest.approx(0.1, abs=1e-6)
    assert found.sigma_px == pytest.approx(0.0, abs=1e-6)
    assert found.large_percent == pytest.approx(10, abs=1)
    assert disparity_errors(dataset, SavedRun(dataset, "x", empty, table)) is None


def test_project_visible_is_the_flow_of_visible_points(dataset, times, grid):
    world = TrueWorld(dataset)
    seen = world.project_visible(times[1], world.points_world(times[0], grid))
    flow = label(dataset, "flow0", times[0], grid, channels=3)[:, :2]
    shown = label(dataset, "covisibility0", times[0], grid)
    found = ~np.isnan(seen[:, 0])
    np.testing.assert_allclose((seen - grid)[found], flow[found], atol=1e-3)
    assert np.abs(flow[found]).max() > 1
    assert found[shown == 0].all()
    near = cv2.dilate((shown == 0).reshape(118, 158).astype(np.uint8), np.ones((3, 3), np.uint8))
    deep = ((shown == 1) | (shown == 2)) & (near.ravel() == 0)
    assert deep.sum() > 50
    assert not found[deep].any()


def test_oracle_replaces_chosen_stages_only(dataset, times, grid):
    frame, ids = frame_at(times[1]), np.arange(len(grid))
    wrong = np.full_like(grid, 3.0)
    beside = Oracle(dataset)
    beside.new_landmarks(frame_at(times[0]), ids, grid)
    beside = beside.pixels(frame_at(times[1]), ids, grid) + 0.5 * DOWN
    guess, last = np.eye(4), se3.exp(np.array([0.1, 0, 0, 0, 0.1, 0]))
    calls = {
        "matches": (("pixels", ids, wrong), 2),
        "features": (("pixels", ids, beside), 2),
        "stereo": (("disparity", grid, wrong[:, 0]), 1),
        "inliers": (("inliers", ids, wrong, np.ones(len(ids), bool)), 2),
        "prediction": (("predicted_pose", times[0], last, guess), 2),
    }
    assert set(calls) == set(ORACLES)
    for chosen in ORACLES:
        oracle = Oracle(dataset, [chosen])
        oracle.new_landmarks(frame_at(times[0]), ids, grid)
        for stage, ((name, *words), _) in calls.items():
            passed = getattr(Hooks(), name)(frame, *words)
            same = np.array_equal(getattr(oracle, name)(frame, *words), passed, equal_nan=True)
            assert same == (stage != chosen), (stage, chosen)


def test_predicted_composes_estimate_and_true_motion(dataset, times):
    T_world_cam = read_truth(dataset).at(np.array(times)).T_ref_frame
    last = se3.exp(np.array([3.0, 1, 0, 0, 0.7, 0]))
    found = Oracle(dataset, ["prediction"]).predicted_pose(
        frame_at(times[1]), times[0], last, np.eye(4)
    )
    np.testing.assert_allclose(
        se3.inverse(last) @ found, se3.inverse(T_world_cam[0]) @ T_world_cam[1], atol=1e-12
    )


def test_inliers_are_close_to_the_projection(dataset, times, grid):
    oracle, frame = Oracle(dataset, ["inliers", "matches", "features"]), frame_at(times[1])
    ids = np.arange(len(grid)) + 500
    oracle.new_landmarks(frame_at(times[0]), ids, grid)
    true = oracle.pixels(frame, ids, grid)
    known = ~np.isnan(true[:, 0])
    ids, true = ids[known], true[known]
    for off, right in ((0.9 * MAX_INLIER_PX, True), (1.1 * MAX_INLIER_PX, False)):
        agree = np.full(len(ids), not right)
        assert (oracle.inliers(frame, ids, true + off * DOWN, agree) == right).all()
    stranger = np.array([7])
    assert not oracle.inliers(frame, stranger, true[:1], np.array([True]))[0]


def test_matches_and_features_are_independent(dataset, times, grid):
    """Half of the landmarks are found half a pixel off, a quarter far off, a quarter not at all."""
    frame, ids = frame_at(times[1]), np.arange(len(grid))
    found = {}
    for stages in (["matches"], ["features"], ["matches", "features"]):
        oracle = Oracle(dataset, stages)
        oracle.new_landmarks(frame_at(times[0]), ids, grid)
        true = oracle._world.project_visible(times[1], oracle._points_of(ids))
        inner = (np.abs(true - [79.5, 59.5]) < [70, 50]).all(axis=1)
        given = true + 0.5 * DOWN
        given[1::4] += 8.0
        given[3::4] = np.nan
        found[tuple(stages)] = oracle.pixels(frame, ids, given) - true
    off, near = given - true, inner & (ids % 2 == 0)
    far, none = inner & (ids % 4 == 1), inner & (ids % 4 == 3)
    assert min(near.sum(), far.sum(), none.sum()) > 500
    matches, features, both = found.values()
    np.testing.assert_array_equal(matches[near], off[near])  # stays where it was found
    np.testing.assert_allclose(matches[far | none], [[0, 0.5]] * (far | none).sum(), atol=1e-9)
    np.testing.assert_allclose(features[near], 0, atol=1e-9)
    np.testing.assert_array_equal(features[far], off[far])
    assert np.isnan(features[none]).all()
    np.testing.assert_allclose(both[inner], 0, atol=1e-9)


def test_disparity_gives_true_depth_for_a_wrong_baseline(dataset, times, grid):
    """Whatever the estimator believes, what it triangulates has the depth of the label."""
    world, frame = TrueWorld(dataset), frame_at(times[0])
    believed = replace(world.rig, baseline_m=1.1 * world.rig.baseline_m)
    oracle = Oracle(dataset, ["stereo"], rig=believed)
    disparity = oracle.disparity(frame, grid, np.full(len(grid), 5.0))
    depth = label(dataset, "depth0", times[0], grid)
    np.testing.assert_allclose(believed.triangulate(grid, disparity)[:, 2], depth, rtol=1e-6)


def test_oracle_noise_has_the_given_std(dataset, times, grid):
    exact, noisy = Oracle(dataset), Oracle(dataset, noise_px=0.2)
    again, other = Oracle(dataset, noise_px=0.2), Oracle(dataset, noise_px=0.2, seed=1)
    ids = np.arange(len(grid))
    for oracle in (exact, noisy, again, other):
        oracle.new_landmarks(frame_at(times[0]), ids, grid)
    inner = (grid > 10).all(axis=1) & (grid < [150, 110]).all(axis=1)
    for name, words in (("pixels", (ids, grid)), ("disparity", (grid, grid[:, 0]))):
        a, b, c, d = (
            getattr(x, name)(frame_at(times[1]), *words)[inner]
            for x in (exact, noisy, again, other)
        )
        off = (b - a)[~np.isnan(a)]
        assert 0.19 < off.std() < 0.21
        assert abs(off.mean()) < 0.01
        np.testing.assert_array_equal(b, c)
        assert np.nanmax(np.abs(d - b)) > 0.1


def test_oracle_errors_name_what_is_missing(dataset, make_scene, tmp_path):
    with pytest.raises(SettingsError, match="unknown stage luck; valid: prediction, matches"):
        Oracle(dataset, ["luck", "stereo"])
    with pytest.raises(DatasetError, match=r"dataset.json"):
        Oracle(tmp_path)
    bare = SETTINGS.model_copy(
        update={
            "labels": LabelSettings(depth=False, disparity=False),
            "drive": DriveSettings(distance_m=0.05),
        }
    )
    record(make_scene(), bare, tmp_path / "bare")
    with pytest.raises(
        DatasetError, match=r"has no depth labels; generate it with labels\.depth=true"
    ):
        Oracle(tmp_path / "bare")
