"""The whole estimator on rendered images: a short drive, a turn, and everything that goes wrong."""

import cv2
import numpy as np
import pytest

from scenes import build_scene
from sim.camera.render import StereoRenderer
from sim.record import record
from sim.settings import (
    DriveSettings,
    LabelSettings,
    RecordSettings,
    RenderSettings,
    RigSettings,
)
from sim.world.rover import PREFIX
from sim.world.world import build_world
from trials.evaluation.alignment import Pair, associate
from trials.evaluation.metrics import errors_over_distance
from vo.config import THESIS, MatchingSettings, OdometrySettings
from vo.contract import se3
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.odometry import StereoOdometry
from vo.recordings.readers import open_sequence, read_truth
from vo.runner import run

pytestmark = [pytest.mark.gl, pytest.mark.slow]

SETTINGS = RecordSettings(
    rig=RigSettings(rate_hz=10),
    drive=DriveSettings(distance_m=1.5),
    render=RenderSettings(samples=0, shadow_size_px=512),
    labels=LabelSettings(depth=False, disparity=False),
)
PATIENCE = OdometrySettings().patience_frames
MOVING = 20
"""From here on the rover drives at full speed, 3 cm a frame."""


@pytest.fixture(scope="module")
def scene():
    return build_scene("brick_court", np.random.default_rng(5), {})


@pytest.fixture(scope="module")
def drive(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("odometry") / "drive"
    record(scene, SETTINGS, folder)
    return folder


@pytest.fixture(scope="module")
def sequence(drive):
    return open_sequence(drive)


@pytest.fixture(scope="module")
def result(sequence):
    return run(sequence, StereoOdometry(sequence.rig))


@pytest.fixture(scope="module")
def frames(sequence):
    """Fifteen frames of steady driving."""
    return [sequence[i] for i in range(MOVING, MOVING + 15)]


@pytest.fixture(scope="module")
def truth(drive, frames):
    """T_first_cam of those frames; for scoring only."""
    known = read_truth(drive)
    index = np.searchsorted(known.timestamps_ns, [x.timestamp_ns for x in frames])
    T_world_cam = known.T_ref_frame[index]
    return se3.inverse(T_world_cam[0]) @ T_world_cam


@pytest.fixture
def odometry(sequence):
    return StereoOdometry(sequence.rig)


def replaced(frame, left=None, right=None):
    return StereoFrame(
        frame.timestamp_ns,
        frame.left if left is None else left,
        frame.right if right is None else right,
    )


def blank(frame):
    grey = np.full_like(frame.left, 90)
    return replaced(frame, grey, grey)


def swapped(frame):
    return replaced(frame, frame.right, frame.left)


def later(frame, frames):
    """The same pictures some frame periods later."""
    return StereoFrame(frame.timestamp_ns + 10**8 * frames, frame.left, frame.right)


def noise(frame):
    rng = np.random.default_rng(frame.timestamp_ns % 2**32)
    return replaced(frame, *rng.integers(0, 256, (2, *frame.left.shape), dtype=np.uint8))


def track_all(odometry, frames):
    """Track, and check what holds for every frame whatever it shows."""
    estimates = [odometry.track(frame) for frame in frames]
    for estimate, frame in zip(estimates, frames, strict=True):
        assert estimate.timestamp_ns == frame.timestamp_ns
        assert isinstance(estimate.status, Status)
        if estimate.status is Status.LOST:
            assert estimate.T_odom_cam is None
            assert estimate.reason
        else:
            R = estimate.T_odom_cam[:3, :3]
            assert np.allclose(R @ R.T, np.eye(3), atol=1e-9)
            assert np.isfinite(estimate.T_odom_cam).all()
    return estimates


def statuses(estimates):
    return [x.status for x in estimates]


def error_m(estimate, T_first_cam):
    return np.linalg.norm(estimate.T_odom_cam[:3, 3] - T_first_cam[:3, 3])


def test_drive_is_tracked_with_little_drift(drive, sequence, result):
    assert statuses(result.estimates) == [Status.START] + [Status.TRACKED] * (len(sequence) - 1)
    pair = associate(read_truth(drive), result.trajectory)
    assert 1.4 < pair.travelled_m[-1] < 1.6
    errors = errors_over_distance(pair, 1.0)
    drift_percent = 100 * errors.translation_m.mean()
    assert len(errors) > 10
    assert 0.0005 < drift_percent < 0.3
    assert 1e-6 < errors.rotation_rad.mean() < np.radians(0.3)


def test_record_is_complete(sequence, result):
    assert [x.timestamp_ns for x in result.estimates] == sequence.timestamps_ns.tolist()
    np.testing.assert_array_equal(result.estimates[0].T_odom_cam, np.eye(4))
    height, width = sequence.rig.height_px, sequence.rig.width_px
    for x in result.estimates[1:]:
        seen = x.observations
        assert x.counts["matches"] >= x.counts["consensus"] > 25
        assert x.counts["found"] >= x.counts["inliers"]
        assert x.counts["inliers"] > 25
        assert seen.inlier.sum() == x.counts["inliers"]
        assert (np.diff(seen.ids) > 0).all()
        assert ((seen.pixels >= 0) & (seen.pixels <= [width - 1, height - 1])).all()
        assert not (seen.disparity_px <= 0).any()
        assert min(x.timings_ms.values()) > 0
    assert set(result.estimates[-1].timings_ms) == {
        "features", "stereo", "matching", "motion", "motion refinement", "guided matching",
        "structure refinement",
    }  # fmt: skip
    found = [i for i, x in enumerate(result.estimates) if "features" in x.counts]
    assert found == [0]  # those of keyframes are detected with the next frame


def test_same_images_give_the_same_trajectory(sequence, result):
    again = track_all(StereoOdometry(sequence.rig), [sequence[i] for i in range(12)])
    for a, b in zip(again, result.estimates, strict=False):
        np.testing.assert_array_equal(a.T_odom_cam, b.T_odom_cam)
        assert a.counts == b.counts


def test_blank_frame_is_lost_and_the_next_is_tracked(odometry, frames, truth):
    shown = [blank(x) if i == 8 else x for i, x in enumerate(frames)]
    estimates = track_all(odometry, shown)
    expected = [Status.START] + [Status.TRACKED] * 7 + [Status.LOST] + [Status.TRACKED] * 6
    assert statuses(estimates) == expected
    assert estimates[8].reason.startswith("left image blank (grey ")
    # The gap costs nothing: the map is still there.
    assert 1e-6 < error_m(estimates[-1], truth[-1]) < 0.005


@pytest.mark.parametrize("spoil", [noise, lambda x: replaced(x, left=x.left * 0)])
def test_noise_or_a_covered_left_camera_is_lost(odometry, frames, truth, spoil):
    shown = [spoil(x) if i in (4, 5) else x for i, x in enumerate(frames[:8])]
    estimates = track_all(odometry, shown)
    assert [i for i, x in enumerate(estimates) if x.status is Status.LOST] == [4, 5]
    assert error_m(estimates[-1], truth[7]) < 0.005


def test_covered_right_camera_is_tracked_by_the_left(odometry, frames, truth):
    """Landmarks are known already: one eye suffices to stay among them."""
    shown = [replaced(x, right=x.right * 0) if i == 5 else x for i, x in enumerate(frames[:8])]
    estimates = track_all(odometry, shown)
    assert Status.LOST not in statuses(estimates)
    assert np.isnan(estimates[5].observations.disparity_px).all()
    assert 1e-6 < error_m(estimates[5], truth[5]) < 0.005


@pytest.fixture(scope="module")
def resumed(sequence, frames):
    """Three frames, darkness beyond patience, and four frames."""
    dark = [blank(x) for x in frames[3:11]]
    assert len(dark) > PATIENCE + 1
    return len(dark), track_all(StereoOdometry(sequence.rig), [*frames[:3], *dark, *frames[11:]])


def test_long_darkness_starts_a_new_segment(resumed):
    dark, estimates = resumed
    assert statuses(estimates[3:]) == [Status.LOST] * dark + [Status.START] + [Status.TRACKED] * 3
    assert estimates[3 + dark].reason == f"new segment after {dark} lost frames"


def test_new_segment_has_new_landmarks(resumed):
    dark, estimates = resumed
    before = np.concatenate([x.observations.ids for x in estimates[1:3]])
    after = np.concatenate([x.observations.ids for x in estimates[4 + dark :]])
    assert not np.isin(after, before).any()


def test_new_segment_is_merged_with_the_lost_one(odometry, frames, truth):
    """After darkness beyond patience the camera stands elsewhere, and soon knows where."""
    dark = [blank(x) for x in frames[4 : 4 + PATIENCE + 2]]
    estimates = track_all(odometry, [*frames[:4], *dark, *frames[4 + len(dark) :]])
    after = estimates[4 + len(dark)]
    assert after.status is Status.START
    assert error_m(after, estimates[3].T_odom_cam) > 0.15
    assert 1e-6 < error_m(after, truth[4 + len(dark)]) < 0.01
    jump = se3.log(se3.inverse(truth[4 + len(dark)]) @ after.T_odom_cam)
    three_sigma = 3 * np.sqrt(np.diag(after.covariance))
    assert (np.abs(jump) < three_sigma).all()
    assert three_sigma[:3].max() < 0.05  # it is not merely unsure
    assert error_m(estimates[-1], truth[-1]) < 0.01


def test_new_segment_elsewhere_is_not_merged(odometry, frames):
    """What shows nothing of the old segment goes on as it moved, and says how unsure."""
    dark = [blank(x) for x in frames[4 : 4 + PATIENCE + 2]]
    upended = [replaced(x, x.left[::-1].copy(), x.right[::-1].copy()) for x in frames[:3]]
    elsewhere = [later(x, 100) for x in upended]
    estimates = track_all(odometry, [*frames[:4], *dark, *elsewhere])
    start = estimates[4 + len(dark)]
    step = se3.log(se3.inverse(estimates[2].T_odom_cam) @ estimates[3].T_odom_cam)
    expected = estimates[3].T_odom_cam @ se3.exp(10 * step)  # for a second, not for ten
    np.testing.assert_allclose(start.T_odom_cam, expected, atol=0.02)
    assert start.covariance[0, 0] > 0.5


def test_gap_is_bridged_by_the_last_motion(odometry, frames, truth):
    """After darkness beyond patience nothing is known again; the path has gone on meanwhile."""
    dark = [blank(x) for x in frames[4 : 4 + PATIENCE + 2]]
    at = 4 + len(dark)
    upended = replaced(frames[at], frames[at].left[::-1].copy(), frames[at].right[::-1].copy())
    start = track_all(odometry, [*frames[:4], *dark, upended])[-1]
    assert start.status is Status.START
    driven_m = error_m(start, se3.inverse(truth[3]) @ truth[at] @ start.T_odom_cam)
    assert 1e-6 < error_m(start, truth[at]) < 0.3 * driven_m
    error = se3.log(se3.inverse(truth[at]) @ start.T_odom_cam)
    sigma = np.sqrt(np.diag(start.covariance))
    assert (np.abs(error) < 3 * sigma).all()
    assert sigma[:3].max() < 0.5


def test_start_on_a_faint_image_is_renewed(odometry, frames):
    """An exposure that begins too low: the first landmarks are rounding, the next ones are not."""
    levels = (0.08, 0.08, 0.2, 0.5, 1, 1)
    shown = [
        replaced(x, *(np.uint8(image * level) for image in (x.left, x.right)))
        for x, level in zip(frames, levels, strict=False)
    ]
    estimates = track_all(odometry, shown)
    assert shown[1].left.std() < 4 < shown[2].left.std()
    assert statuses(estimates)[3:] == [Status.TRACKED] * 3
    assert set(statuses(estimates)[1:3]) <= {Status.TRACKED, Status.WEAK}
    renewed = estimates[3].observations.ids
    assert not np.isin(renewed, estimates[1].observations.ids).all()


def test_final_result_has_every_posed_frame_and_a_map(result, sequence):
    smoothed, points = result.final.trajectory, result.final.points
    posed = [x for x in result.estimates if x.T_odom_cam is not None]
    assert smoothed.timestamps_ns.tolist() == [x.timestamp_ns for x in posed]
    moved_m = [error_m(x, T) for x, T in zip(posed, smoothed.T_ref_frame, strict=True)]
    assert 0 < max(moved_m) < 0.01
    assert len(np.unique(points.ids)) == len(points.ids) > 300
    assert points.views.min() >= OdometrySettings().refinement.min_views
    first = points.points_odom[points.points_odom[:, 2] < 1.0]
    assert np.median(sequence.rig.project(first)[:, 1]) > sequence.rig.cy_px  # on the ground


def test_covariance_grows_and_steps_are_small(result):
    posed = [x for x in result.estimates if x.T_odom_cam is not None]
    spread_m = np.array([np.sqrt(np.trace(x.covariance[:3, :3])) for x in posed])
    step_m = np.array([np.sqrt(np.trace(x.step_covariance[:3, :3])) for x in posed])
    assert 0 < spread_m[20] < spread_m[-1] < 0.02
    assert 1e-6 < np.median(step_m[1:]) < 1e-3


@pytest.mark.parametrize("kernel", ["box", "star"])
def test_alternative_methods_track(sequence, frames, truth, kernel):
    settings = OdometrySettings.model_validate(
        {
            "features": {"kernel": kernel},
            "stereo": {"method": "semi_global"},
            "motion": {"method": "absolute", "solver": "fischler_bolles", "scheme": "preemptive"},
        }
    )
    estimates = track_all(StereoOdometry(sequence.rig, settings), frames[:8])
    assert Status.LOST not in statuses(estimates)
    assert 1e-6 < error_m(estimates[-1], truth[7]) < 0.01


def test_thesis_preset_tracks_with_more_drift(sequence, frames, truth):
    estimates = track_all(StereoOdometry(sequence.rig, THESIS), frames)
    assert Status.LOST not in statuses(estimates)
    ours = track_all(StereoOdometry(sequence.rig), frames)
    assert error_m(ours[-1], truth[-1]) < error_m(estimates[-1], truth[-1]) < 0.03


def test_noisy_images_are_smoothed_and_tracked(odometry, frames, truth):
    """Noise of 9 grey levels hides the depth of nearly all features until it is smoothed."""
    rng = np.random.default_rng(0)

    def grainy(image):
        return np.clip(image / 2 + rng.normal(30, 9, image.shape), 0, 255).astype(np.uint8)

    shown = [replaced(x, grainy(x.left), grainy(x.right)) for x in frames]
    estimates = track_all(odometry, shown)
    assert Status.LOST not in statuses(estimates)
    assert error_m(estimates[-1], truth[-1]) < 0.02


@pytest.mark.parametrize(("lower_px", "mode"), [(0.0, "off"), (0.5, "off"), (0.5, "auto")])
def test_vertical_offset_is_reported_or_corrected(sequence, lower_px, mode):
    """A right eye that looks half a pixel higher than the calibration says."""
    settings = OdometrySettings.model_validate(
        {"refinement": {"keyframe_parallax_px": 0}, "self_calibration": mode}
    )
    odometry = StereoOdometry(sequence.rig, settings)
    down = np.float32([[1, 0, 0], [0, 1, lower_px]])
    size = (sequence.rig.width_px, sequence.rig.height_px)
    frames = [sequence[i] for i in range(MOVING, MOVING + 14)]
    shown = [replaced(x, right=cv2.warpAffine(x.right, down, size)) for x in frames]
    reasons = [x.reason for x in track_all(odometry, shown)]
    assert not any(reasons[:10])
    if mode == "auto":
        assert not any(reasons)
        errors = odometry.state.stereo_errors
        f_px = sequence.rig.f_px
        assert errors.row_px + f_px * errors.pitch_rad == pytest.approx(lower_px, abs=0.1)
    elif lower_px:
        assert reasons[-1].startswith("right rows lie +0.")
        assert "calibration" in reasons[-1]
    else:
        assert not any(reasons)


def test_blank_images_are_lost(odometry, frames):
    estimates = track_all(odometry, [blank(x) for x in frames])
    assert statuses(estimates) == [Status.LOST] * len(frames)
    assert all(f"{eye} image blank" in estimates[0].reason for eye in ("left", "right"))


def test_blank_first_image_delays_the_start(odometry, frames):
    estimates = track_all(odometry, [blank(frames[0]), *frames[1:4]])
    assert statuses(estimates) == [Status.LOST, Status.START, Status.TRACKED, Status.TRACKED]
    np.testing.assert_array_equal(estimates[1].T_odom_cam, np.eye(4))


def test_swapped_images_do_not_raise(odometry, frames):
    estimates = track_all(odometry, [swapped(x) for x in frames[:6]])
    assert Status.TRACKED not in statuses(estimates)


def test_swapped_images_on_the_way_recover(odometry, frames, truth):
    """The odd frame may be lost or held by its left eye's landmarks, which shifts it by the
    baseline; most of that must be gone again with the next ones."""
    estimates = track_all(odometry, [*frames[:4], swapped(frames[4]), *frames[5:8]])
    assert Status.LOST not in statuses(estimates[5:])
    assert error_m(estimates[-1], truth[7]) < 0.01


def test_images_of_noise_are_not_tracked(odometry, frames):
    estimates = track_all(odometry, [noise(x) for x in frames[:8]])
    assert Status.TRACKED not in statuses(estimates)


def test_frames_out_of_order_are_refused(odometry, frames, truth):
    """A frame out of order is refused, and changes nothing."""
    estimates = track_all(odometry, [*frames[:4], frames[2], frames[3], *frames[4:8]])
    assert [i for i, x in enumerate(estimates) if x.status is Status.LOST] == [4, 5]
    assert estimates[4].reason.startswith("not later than the frame before, at ")
    plain = track_all(StereoOdometry(odometry.rig), frames[:8])
    np.testing.assert_array_equal(estimates[-1].T_odom_cam, plain[-1].T_odom_cam)


def test_odd_image_sizes_do_not_raise(frames):
    """What fits no block, cell or kernel is only fewer features."""
    for width, height in ((641, 479), (97, 83), (33, 21)):
        rig = StereoRig(width, height, 300.0, (width - 1) / 2, (height - 1) / 2, 0.09)
        small = [
            replaced(x, *(cv2.resize(eye, (width, height)) for eye in (x.left, x.right)))
            for x in frames[:3]
        ]
        for preset in (OdometrySettings(), THESIS):
            estimates = track_all(StereoOdometry(rig, preset), small)
            assert all(x.T_odom_cam is not None or x.reason for x in estimates)


def test_images_of_six_pixels_are_lost(frames):
    rig = StereoRig(3, 2, 300.0, 1.0, 0.5, 0.09)
    tiny = [replaced(x, x.left[:2, :3].copy(), x.right[:2, :3].copy()) for x in frames[:3]]
    for preset in (OdometrySettings(), THESIS):
        assert statuses(track_all(StereoOdometry(rig, preset), tiny)) == [Status.LOST] * 3


def test_gap_of_minutes_is_tracked(odometry, frames, truth):
    """Nothing is predicted over a gap but what the pictures say."""
    estimates = track_all(odometry, [*frames[:4], *(later(x, 3000) for x in frames[6:9])])
    assert statuses(estimates) == [Status.START] + [Status.TRACKED] * 6
    assert 1e-6 < error_m(estimates[-1], truth[8]) < 0.01


@pytest.mark.parametrize("prior", [True, False])
@pytest.mark.parametrize("circular_check", [True, False])
def test_decoupled_pose_and_circular_check_track(sequence, frames, truth, prior, circular_check):
    motion = {"method": "decoupled", "landmark_prior": prior}
    settings = OdometrySettings.model_validate(
        {"motion": motion, "matching": {"circular_check": circular_check}}
    )
    estimates = track_all(StereoOdometry(sequence.rig, settings), frames[:8])
    assert statuses(estimates) == [Status.START] + [Status.TRACKED] * 7
    assert 1e-6 < error_m(estimates[-1], truth[7]) < 0.01


def test_single_frame_starts_at_the_origin(odometry, frames):
    (estimate,) = track_all(odometry, frames[:1])
    assert estimate.status is Status.START
    np.testing.assert_array_equal(estimate.T_odom_cam, np.eye(4))


def test_repeated_image_does_not_move(odometry, frames):
    estimates = track_all(odometry, [later(frames[0], i) for i in range(4)])
    assert statuses(estimates) == [Status.START] + [Status.TRACKED] * 3
    assert error_m(estimates[-1], np.eye(4)) < 1e-4


def grainy(frame, seed):
    """A frame with the noise of a fair camera, 2 grey levels."""
    rng = np.random.default_rng(seed)
    eyes = (
        np.clip(np.rint(eye + rng.normal(0, 2, eye.shape)), 0, 255).astype(np.uint8)
        for eye in (frame.left, frame.right)
    )
    return replaced(frame, *eyes)


def halted(rig, frame, stationary, count=100):
    """Stand, at 10 Hz; how far the pose moved after the first second, m and degrees."""
    odometry = StereoOdometry(rig, OdometrySettings(stationary=stationary))
    estimates = track_all(odometry, [grainy(later(frame, i), i) for i in range(count)])
    assert statuses(estimates) == [Status.START] + [Status.TRACKED] * (count - 1)
    moved = [se3.inverse(estimates[10].T_odom_cam) @ x.T_odom_cam for x in estimates[10:]]
    turned_rad = max(se3.rotation_angle(T) for T in moved)
    return max(np.linalg.norm(T[:3, 3]) for T in moved), np.degrees(turned_rad)


def test_stationary_camera_does_not_drift(sequence, frames):
    """By image alone: a sixth of a minute moves it by a sixth of 1 mm and 0.01 degrees at most."""
    far_m, far_deg = halted(sequence.rig, frames[0], "image")
    assert far_m < 1e-3 / 6
    assert far_deg < 0.01 / 6
    noisy_m, _ = halted(sequence.rig, frames[0], "none", count=40)
    assert noisy_m > 2 * max(far_m, 1e-5)


def carried(scene, motions):
    """What a camera sees that moves by tangents (v, w) from the start, and the truth."""
    world = build_world(scene, SETTINGS)
    joint = world.data.joint(PREFIX + "free")
    T_world_first = world.T_world_body @ world.rig.T_body_cam
    frames = []
    with StereoRenderer(world, SETTINGS.render) as renderer:
        for i, T_first_cam in enumerate(se3.exp(motions)):
            T_world_body = T_world_first @ T_first_cam @ se3.inverse(world.rig.T_body_cam)
            joint.qpos = np.concatenate([T_world_body[:3, 3], se3.to_quat_wxyz(T_world_body)])
            world.place_bodies()
            left, right = renderer.render_images()
            frames.append(StereoFrame(10**8 * i, left, right))
    return frames, se3.exp(motions)


def test_slow_creep_is_not_held(odometry, scene):
    """A tenth of a millimetre a frame is below the noise of a frame; 40 of them are not."""
    motions = np.zeros((40, 6))
    motions[:, 2] = 1e-4 * np.arange(40)
    frames, truth = carried(scene, motions)
    estimates = track_all(odometry, [grainy(x, i) for i, x in enumerate(frames)])
    errors_m = [error_m(x, T) for x, T in zip(estimates, truth, strict=True)]
    assert max(errors_m) < 1e-3
    assert errors_m[-1] < 0.2 * truth[-1, 2, 3]


@pytest.fixture(scope="module")
def turn(scene):
    """Views of a camera that turns by 2.5 degrees a frame about its own upright axis."""
    motions = np.zeros((15, 6))
    motions[:, 4] = -np.radians(2.5) * np.arange(15)
    return carried(scene, motions)


def test_rotation_on_the_spot_is_tracked(odometry, turn):
    frames, truth = turn
    estimates = track_all(odometry, frames)
    assert statuses(estimates) == [Status.START] + [Status.TRACKED] * 14
    T = np.array([x.T_odom_cam for x in estimates])
    pair = Pair(np.arange(15), truth, T)
    error = se3.inverse(pair.T_world_cam) @ pair.T_odom_cam
    assert np.degrees(se3.rotation_angle(T[-1])) == pytest.approx(35, abs=0.3)
    assert 1e-6 < se3.rotation_angle(error)[-1] < np.radians(0.3)
    assert 1e-6 < np.linalg.norm(error[-1, :3, 3]) < 0.01


@pytest.fixture(scope="module")
def shake(scene):
    """Views of a camera that is thrown about at random, by up to 9 degrees from frame to frame."""
    motions = np.zeros((12, 6))
    motions[1:, 3:] = np.radians([3, 8, 3]) * np.random.default_rng(3).uniform(-1, 1, (11, 3))
    motions[:, 2] = 0.02 * np.arange(12)
    return carried(scene, motions)


def shaken(rig, shake, min_inlier_ratio):
    """Frames lost, and the largest error of the others in metres."""
    settings = OdometrySettings(matching=MatchingSettings(min_inlier_ratio=min_inlier_ratio))
    frames, truth = shake
    estimates = track_all(StereoOdometry(rig, settings), frames)
    posed = [x.T_odom_cam is not None for x in estimates]
    errors_m = [error_m(x, T) for x, T, p in zip(estimates, truth, posed, strict=True) if p]
    return posed.count(False), max(errors_m)


def test_shaking_camera_is_tracked_by_the_rotation_prior(sequence, shake):
    lost, worst_m = shaken(sequence.rig, shake, OdometrySettings().matching.min_inlier_ratio)
    assert lost == 0
    assert 1e-6 < worst_m < 0.001
    lost, worst_m = shaken(sequence.rig, shake, 0)
    assert lost > 0 or worst_m > 0.1


def smeared(frame, px):
    """Both pictures as a fast turn smears them."""
    kernel = np.full((1, px), 1 / px)
    left, right = (cv2.filter2D(x, -1, kernel) for x in (frame.left, frame.right))
    return replaced(frame, left, right)


def smear_error_m(rig, frames, truth, min_inlier_ratio):
    """Of the last of seven smeared frames after five sharp ones; infinite if it has no pose."""
    matching = MatchingSettings(search="features", min_inlier_ratio=min_inlier_ratio)
    settings = OdometrySettings(matching=matching)
    shown = [*frames[:5], *(smeared(x, 33) for x in frames[5:12])]
    estimates = track_all(StereoOdometry(rig, settings), shown)
    lost = Status.LOST in statuses(estimates) or Status.START in statuses(estimates)[1:]
    return np.inf if lost else error_m(estimates[-1], truth[11])


def test_blurred_images_are_tracked_by_klt(sequence, frames, truth):
    assert 1e-6 < smear_error_m(sequence.rig, frames, truth, 0.22) < 0.02
    assert smear_error_m(sequence.rig, frames, truth, 0) > 0.04
