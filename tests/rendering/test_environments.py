"""Trials through Gymnasium, in a yard: its own checks, repeatability, outcomes, replays."""

import subprocess
import sys
from importlib.metadata import entry_points

import cv2
import gymnasium
import mujoco
import numpy as np
import pytest
from gym_worlds import PLAIN, YARD, write_yard
from gymnasium.utils.env_checker import check_env

import trials.gym
from scenes.scene import Scene
from sim.camera_names import DEFAULT_CAMERA
from sim.certificate.verify import verify
from sim.sensors.inertial import T_body_imu, ideal_readings
from sim.settings import ImuSettings
from sim.world.world import START_S
from trials.estimators.choice import make_estimator
from trials.gym.media import Filmed
from trials.gym.world.start_goal_sampling import TrialError
from vo.contract.errors import SettingsError
from vo.contract.estimator import Estimate, Status
from vo.recordings.readers import open_sequence, read_truth
from vo.runner import run

pytestmark = pytest.mark.gl

SMALL = {"rig.width_px": 160, "rig.height_px": 120, "render.samples": 0}
ICE = {**SMALL, "terrain.ice_share": 0.8, "terrain.ice_friction": 0.01}
MEDIUM = {"rig.width_px": 320, "rig.height_px": 240, "render.samples": 0}
QUICK = {"settings": SMALL, "localization": "truth", "camera": "ideal"}
"""Images of the ideal camera take the least time; tests of images have the default one, too."""
ALL = ("left", "right", "disparity", "pose", "encoders", "imu", "goal")
NAMES = tuple(trials.gym.ENVIRONMENTS)
NAV, ROUTE, EXPLORE = NAMES


@pytest.fixture(scope="module")
def yard(tmp_path_factory) -> str:
    return str(write_yard(tmp_path_factory.mktemp("gym")))


@pytest.fixture
def make(yard):
    made = []

    def build(name: str = NAV, **options):
        options = {"scene": yard, **QUICK, **options}
        made.append(gymnasium.make(name, disable_env_checker=True, **options))
        return made[-1]

    yield build
    for env in made:
        env.close()


def towards(goal: np.ndarray, shy: float = 2.0) -> np.ndarray:
    """Turn to the goal, and drive when it is ahead."""
    angle = np.arctan2(goal[1], goal[0])
    return np.array([max(0.0, np.cos(angle)) ** 3, np.clip(shy * angle, -1, 1)], np.float32)


def drive(env, steps: int = 2000, **reset):
    """Drive by the goal alone until the trial is over; all observations, the last step's rest."""
    seen, info = env.reset(**reset)
    everything, rewards = [(seen, info)], []
    for _ in range(steps):
        seen, reward, terminated, truncated, info = env.step(towards(seen["goal"]))
        everything.append((seen, info))
        rewards.append(reward)
        if terminated or truncated:
            break
    return everything, rewards


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("error")
def test_environment_passes_the_checks_of_gymnasium(yard, name):
    env = gymnasium.make(
        name,
        scene=yard,
        settings=SMALL,
        observe=ALL,
        localization="wheels",
        render_mode="rgb_array",
    )
    check_env(env.unwrapped)


def test_entry_point_registers_the_environments():
    found = [e for e in entry_points(group="gymnasium.envs") if e.value.startswith("trials.gym")]
    if not found:
        pytest.skip("installed before the entry point was declared")
    assert found[0].load() is trials.gym.register_environments
    found[0].load()()
    assert set(NAMES) <= set(gymnasium.registry)


@pytest.mark.parametrize(
    "options",
    [
        {"localization": "vo", "observe": ALL, "camera": DEFAULT_CAMERA},
        {"disturb": "noise,blur", "observe": ("left", "right", "imu", "goal")},
        {"disturb": "brick_bump,drop=0.5", "localization": "wheels", "observe": ("left", "goal")},
    ],
)
def test_seed_and_actions_decide_the_trial(make, options):
    first, _ = drive(make(**options), 12, seed=4)
    second, _ = drive(make(**options), 12, seed=4)
    assert len(first) == len(second) > 10
    for (a, info_a), (b, info_b) in zip(first, second, strict=True):
        for channel in a:
            np.testing.assert_array_equal(a[channel], b[channel], err_msg=channel)
        np.testing.assert_array_equal(info_a["T_estimated"], info_b["T_estimated"])
    env = make(**options)
    drive(env, 5, seed=4)
    again, _ = drive(env, 12, seed=4)
    np.testing.assert_array_equal(again[-1][0]["left"], first[-1][0]["left"])
    other, _ = drive(env, 3, seed=5)
    assert not np.array_equal(other[0][1]["T_true"], first[0][1]["T_true"])


def test_reset_takes_a_layout_that_is_kept(make):
    """The last two remain by default: a reset in one of them builds nothing, and shows the same."""
    env = make(observe=("left", "pose"))
    first, _ = env.reset(seed=0)
    built = env.unwrapped.instance
    sensors = built.camera._camera.sensors
    env.reset(seed=1)
    again, _ = env.reset(seed=0)
    assert env.unwrapped.instance is built
    assert built.camera._camera.sensors is sensors
    np.testing.assert_array_equal(again["left"], first["left"])
    np.testing.assert_array_equal(again["pose"], first["pose"])
    for seed in (2, 3, 0):
        third, _ = env.reset(seed=seed)
    assert env.unwrapped.instance is not built
    np.testing.assert_array_equal(third["left"], first["left"])


def test_goal_is_reached_by_the_true_position(make):
    env = make(observe=("goal",), localization="truth")
    options = {"start": (-2.0, 1.5, 0.3), "goal": (1.5, 1.5)}
    seen, rewards = drive(env, seed=1, options=options)
    info = seen[-1][1]
    assert info["outcome"] == "success"
    assert info["success"]
    assert np.linalg.norm(info["T_true"][:2, 3] - options["goal"]) <= 0.3
    assert 0.9 < info["spl"] <= 1.0
    assert 3.0 < info["driven_m"] < 4.0
    assert info["way_m"] == pytest.approx(3.5, abs=1e-6)
    assert sum(rewards) == pytest.approx(10 + 3.5 - 0.3 - 0.01 * len(rewards), abs=0.3)
    with pytest.raises(TrialError, match="call reset"):
        env.unwrapped.step(np.zeros(2))


def test_rover_drives_at_the_commanded_speed(make):
    env = make(observe=("goal", "encoders"), rate_hz=20.0)
    env.reset(seed=0, options={"start": (-2.0, 1.5, 0.0), "goal": (2.0, 1.5)})
    for _ in range(20):
        env.step(np.array([0.8, 0.0]))
    *_, before = env.step(np.array([0.8, 0.0]))
    for _ in range(20):
        *_, after = env.step(np.array([0.8, 0.0]))
    moved = after["T_true"][:2, 3] - before["T_true"][:2, 3]
    np.testing.assert_allclose(moved, [0.4, 0.0], atol=0.006)
    env.reset(seed=0, options={"start": (-2.0, 1.5, 0.0), "goal": (2.0, 1.5)})
    for _ in range(20):
        *_, before = env.step(np.array([0.0, 0.5]))
    for _ in range(20):
        *_, after = env.step(np.array([0.0, 0.5]))
    turn = before["T_true"][:3, :3].T @ after["T_true"][:3, :3]
    assert np.arctan2(turn[1, 0], turn[0, 0]) == pytest.approx(0.5, abs=0.03)


def test_inertial_readings_are_those_of_the_true_motion(make):
    quiet = {"scene": make().unwrapped.trial.scene, "settings": {**SMALL, "imu.noise": 0.0}}
    env = make(**quiet, observe=("imu",), record=True)
    env.reset(seed=4)
    action = np.array([1.0, 0.6], np.float32)
    readings = [env.step(action)[0]["imu"] for _ in range(12)][:-1]
    simulation = env.unwrapped.instance.simulation
    motions = simulation.log.trip(np.ones(13, bool), "").motions
    ends = (START_S * 1e9 + np.arange(12) * 1e9 / env.unwrapped.trial.rate_hz).astype(int)
    rows = np.searchsorted(motions.times_ns, ends - 1000)
    motion = motions.T_world_body, motions.v_world_body, motions.w_world_body
    unit = T_body_imu(ImuSettings())
    gravity = simulation.world.gravity_mps2
    true = ideal_readings(ends, *(x[rows] for x in motion), unit, gravity)
    found = np.array(readings)[1:]  # in the first, the command changes when it ends
    np.testing.assert_allclose(found[:, :3], true.gyro_radps[1:], atol=1e-5)
    np.testing.assert_allclose(found[:, 3:], true.accel_mps2[1:], atol=1e-5)
    assert np.ptp(true.accel_mps2[1:, 0]) > 0.5  # it speeds up


def test_start_with_the_camera_inside_a_thing_is_refused(make, tmp_path):
    fog = '<geom name="fog" type="box" pos="1.5 0 .4" size=".5 1 .4" contype="0" conaffinity="0"/>'
    (tmp_path / "fog.xml").write_text(
        YARD.replace('file="noise.png"', PLAIN).replace("</worldbody>", fog + "</worldbody>")
    )
    env = make(scene=str(tmp_path / "fog.xml"), observe=("goal",))
    with pytest.raises(TrialError, match=r"start \(1\.5, 0\) m: the camera is inside fog"):
        env.reset(seed=0, options={"start": (1.5, 0.0, 0.0)})


def test_wheel_actions_equal_twist_actions(make):
    # Half a metre a second and one radian a second: 0.69 m/s at the rim of the faster wheel.
    start = {"start": (-2.0, 1.5, 0.0), "goal": (2.0, 1.5)}
    ends = []
    for action, command in (("twist", (0.5, 0.5)), ("wheels", (0.155 / 0.69, 0.345 / 0.69))):
        env = make(observe=("goal",), action=action)
        env.reset(seed=0, options=start)
        for _ in range(20):
            *_, info = env.step(np.array(command))
        ends.append(info["T_true"])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


def test_collision_ends_the_trial_and_names_the_pillar(make):
    env = make(observe=("goal",))
    seen, rewards = drive(env, seed=0, options={"start": (-2.0, 0.0, 0.0), "goal": (2.0, 0.0)})
    info = seen[-1][1]
    assert info["outcome"] == "collision"
    assert info["contacts"] == ("pillar",)
    assert info["T_true"][0, 3] == pytest.approx(-0.3 - 0.06, abs=0.06)  # chassis and tyres
    assert rewards[-1] < -9


def test_wheels_without_effect_are_reported_as_stuck(make):
    env = make(observe=("goal",), settings={**SMALL, "rover.wheel_torque_max_nm": 0.001})
    seen, _ = drive(env, seed=0, options={"start": (-2.0, 1.5, 0.0), "goal": (2.0, 1.5)})
    assert seen[-1][1]["outcome"] == "stuck"
    assert 10.0 < seen[-1][1]["time_s"] < 10.5
    env.reset(seed=0)
    for _ in range(180):
        _, _, terminated, _, info = env.step(np.zeros(2))
    assert not terminated  # a rover without a command is not stuck
    assert info["outcome"] == ""


def test_time_limit_truncates_the_trial(make):
    env = make(observe=("goal",), time_limit_s=1.0)
    env.reset(seed=0)
    ends = [env.step(np.zeros(2)) for _ in range(15)]
    assert [e[3] for e in ends] == [False] * 14 + [True]
    assert ends[-1][4]["outcome"] == "timeout"
    assert not ends[-1][2]


def test_route_is_followed_to_its_end(make, yard):
    settings = {**SMALL, "drive.waypoints": ((-2.0, 1.0), (0.5, 1.5), (2.0, 1.0))}
    env = make(ROUTE, observe=("goal",), settings=settings)
    seen, rewards = drive(env, seed=0)
    info = seen[-1][1]
    assert info["outcome"] == "success"
    assert np.linalg.norm(info["T_true"][:2, 3] - (2.0, 1.0)) < 0.31
    assert info["share"] == pytest.approx(1 - 0.3 / info["way_m"], abs=0.03)
    env = make(ROUTE, observe=("goal",), settings=settings, stray_m=0.3)
    env.reset(seed=0)
    for _ in range(200):
        _, _, terminated, _, info = env.step(np.array([0.5, 1.0]))
        if terminated:
            break
    assert info["outcome"] == "strayed"
    assert sum(rewards) > 10


def test_explore_counts_the_view_and_ends_at_the_start(make):
    env = make(EXPLORE, observe=("goal",), view_m=3.0, cover_share=0.6)
    _, info = env.reset(seed=0, options={"start": (-2.0, 0.0, 1.5)})
    task, space = env.unwrapped.episode.task, env.unwrapped.instance.traversable.space

    def in_view(x, y):
        return bool(task.covered[tuple(space.cells(np.array([x, y])))])

    assert in_view(-1.0, 0.0)
    assert in_view(-2.0, 2.5)
    assert not in_view(0.6, 0.0)  # behind the pillar
    assert not in_view(2.0, 0.0)  # too far
    before = task.covered.sum()
    shares = []
    for place in ((-2.0, 1.5), (1.5, 1.8), (-2.0, 0.0)):
        for _ in range(600):
            there = np.array([*place, 0.0, 1.0])
            here = np.linalg.inv(info["T_true"]) @ there
            if np.linalg.norm(here[:2]) < 0.2 or info["outcome"]:
                break
            _, _, _, _, info = env.step(towards(here[:2]))
            shares.append(info["share"])
    assert in_view(2.0, 0.0)
    assert task.covered.sum() > 1.5 * before
    assert (np.diff(shares) >= 0).all()
    assert shares[0] < 1.0
    assert info["outcome"] == "success"
    assert np.linalg.norm(info["T_true"][:2, 3] - (-2.0, 0.0)) <= 0.5


def test_visual_odometry_is_close_to_the_truth_but_not_it(make):
    env = make(localization="vo", settings=MEDIUM, observe=("goal",))
    seen, _ = drive(env, seed=1, options={"start": (-2.0, 1.5, 0.0), "goal": (0.0, 1.5)})
    errors = np.array([info["error_m"] for _, info in seen[1:]])
    assert seen[-1][1]["outcome"] == "success"
    assert 1e-5 < errors[-1] < 0.1
    assert {info["status"] for _, info in seen} <= {"start", "tracked", "weak"}


def test_wheel_odometry_drifts_on_ice(make):
    errors = []
    for settings in (SMALL, ICE):
        env = make(
            localization="wheels", observe=("goal",), settings=settings, acceleration_mps2=8.0
        )
        env.reset(seed=1, options={"start": (-2.0, 1.5, 0.0), "goal": (2.0, 1.5)})
        for k in range(60):
            *_, info = env.step(np.array([0.8 * (k // 6 % 2), 0.0]))
        errors.append(info["error_m"])
    assert 1e-6 < errors[0] < 0.02
    assert errors[1] > 3 * errors[0]
    assert errors[1] > 0.03


class Forgetful:
    """An estimator that gives up after its third frame."""

    def __init__(self, rig):
        self._frames = 0

    def track(self, frame):
        self._frames += 1
        if self._frames > 3:
            return Estimate(frame.timestamp_ns, Status.LOST, None, "forgot")
        T = np.eye(4)
        T[2, 3] = 0.1 * self._frames
        return Estimate(frame.timestamp_ns, Status.TRACKED, T)


def test_lost_estimator_holds_its_pose_or_ends_the_trial(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "forgetful", sys.modules[__name__])
    env = make(localization="forgetful:Forgetful", observe=("goal",))
    env.reset(seed=0)
    infos = [env.step(np.zeros(2))[4] for _ in range(6)]
    assert [i["status"] for i in infos] == ["tracked"] * 2 + ["lost"] * 4
    assert infos[-1]["reason"] == "forgot"
    np.testing.assert_array_equal(infos[1]["T_estimated"], infos[-1]["T_estimated"])
    env = make(localization="forgetful:Forgetful", observe=("goal",), on_loss="end")
    env.reset(seed=0)
    ends = [env.step(np.zeros(2)) for _ in range(3)]
    assert [e[2] for e in ends] == [False, False, True]
    assert ends[-1][4]["outcome"] == "lost"


@pytest.mark.parametrize(
    "action", [np.array([np.nan, 0.0]), np.array([0.0, 1.2]), np.zeros(3), np.array([np.inf, 0])]
)
def test_action_out_of_range_is_refused(make, action):
    env = make(observe=("goal",))
    env.reset(seed=0)
    with pytest.raises(TrialError, match=r"expected \(forward, turn\), each -1 to 1"):
        env.step(action)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"scene": "moon"}, "unknown scene moon; valid: asphalt"),
        (
            {"localization": "gps"},
            "unknown localization gps; valid: truth, drift:PERCENT, wheels, vo",
        ),
        ({"speed": 2}, "unknown setting speed; valid here: acceleration_mps2"),
        ({"observe": ("smell",)}, "setting observe: unknown channel smell; valid: left, right"),
        ({"observe": "smell"}, "setting observe: unknown channel smell; valid: left, right"),
        ({"observe": ()}, "setting observe: names no channel; valid: left, right"),
        ({"disturb": "hail"}, "unknown disturbance hail"),
        ({"settings": {"rig.width": 3}}, "unknown setting rig.width; valid here"),
        ({"scene_options": {"walls": 3}}, "unknown option walls"),
    ],
)
def test_options_are_checked_when_made(yard, options, said):
    scene = {"scene": "warehouse"} if "scene_options" in options else {"scene": yard}
    with pytest.raises(SettingsError) as error:
        gymnasium.make(NAV, **{**scene, **options}).reset(seed=0)
    assert said in str(error.value)


def test_reset_refuses_impossible_places(make):
    env = make(observe=("goal",))
    for options, said in (
        ({"goal": (0.0, 0.0)}, "goal (0, 0) m: inside pillar"),
        ({"start": (2.9, 0, 0)}, "start (2.9, 0) m"),
        ({"goal": (3.6, 0.0), "start": (2, 0, 0)}, "no path from the start"),
        ({"goal": (np.nan, 0.0)}, "expected (x, y)"),
        ({"gaol": (1.0, 1.0)}, "unknown option gaol; valid: layout, localization, start, goal"),
    ):
        with pytest.raises(TrialError) as error:
            env.reset(seed=0, options=options)
        assert said in str(error.value)
    env.reset(seed=0)  # goes on after all of them


@pytest.mark.filterwarnings("error")
def test_human_render_mode_needs_a_display(yard, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(SettingsError, match="render_mode human: there is no display"):
        trials.gym.env.environments.RoverNav(render_mode="human", scene=yard)


def test_render_shows_the_true_and_the_estimated_path(make):
    env = make(observe=("goal",), render_mode="rgb_array")
    env.reset(seed=0, options={"start": (-2.0, 1.5, 0.0), "goal": (2.0, 1.5)})
    first = env.render()
    for _ in range(45):
        env.step(np.array([1.0, 0.0]))
    last = env.render()
    assert first.shape == last.shape == (388, 960, 3)
    assert first.dtype == np.uint8
    above = last[:360, 480:]
    blue = np.argwhere((above == (32, 120, 255)).all(axis=-1))
    x_min, _, x_max, _ = env.unwrapped.instance.scene.extent_m
    span_m = np.ptp(blue[:, 1]) / 360 * (x_max - x_min)
    assert 1.2 < span_m < 2.2  # driven in three seconds, and the rover's arrow
    assert np.abs(first[:360, :480].astype(int) - last[:360, :480]).mean() > 3


def test_film_has_a_frame_for_every_step(make, tmp_path):
    env = Filmed(make(observe=("goal",), render_mode="rgb_array"), tmp_path / "trial.mp4")
    for _ in range(2):
        env.reset(seed=0)
        for _ in range(5):
            env.step(np.array([0.3, 0.1]))
    env.close()
    for name in ("trial.mp4", "trial_1.mp4"):
        video = cv2.VideoCapture(str(tmp_path / name))
        assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 6
        assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(15)
    with pytest.raises(SettingsError, match="render_mode"):
        Filmed(make(observe=("goal",)), tmp_path / "x.mp4")


@pytest.mark.parametrize(
    ("disturb", "crf"), [("", 0), ("drop=0.5", 30), ("noise=0.3,blur=0.3,drop=0.3", 0)]
)
def test_saved_trial_replays_to_the_same_poses(make, tmp_path, disturb, crf):
    settings = {**MEDIUM, "sensor.h264_crf": crf}
    env = make(
        localization="vo", settings=settings, observe=("left", "right", "goal"),
        record=True, disturb=disturb, camera=DEFAULT_CAMERA,
    )  # fmt: skip
    seen, _ = drive(env, 18, seed=2)
    out = tmp_path / "drive"
    env.unwrapped.save_dataset(str(out))
    assert verify(out) == []
    sequence, truth = open_sequence(out), read_truth(out)
    delivered = env.unwrapped.instance.camera.delivered
    kept = [pair for pair, kept in zip(seen, delivered, strict=True) if kept]
    assert len(sequence) == len(kept) == sum(delivered)
    assert truth is not None
    for frame, (observation, info) in zip(sequence, kept, strict=True):
        np.testing.assert_array_equal(frame.left, observation["left"][..., 0])
        np.testing.assert_array_equal(frame.right, observation["right"][..., 0])
        there = truth.T_ref_frame[np.searchsorted(truth.timestamps_ns, frame.timestamp_ns)]
        np.testing.assert_allclose(there, info["T_true"] @ sequence.rig.T_body_cam, atol=1e-9)
    replayed = run(sequence, make_estimator("driftyard", sequence.rig)[0])
    T_world_odom = kept[0][1]["T_true"] @ sequence.rig.T_body_cam
    T_cam_body = np.linalg.inv(sequence.rig.T_body_cam)
    for estimate, (_, info) in zip(replayed.estimates, kept, strict=True):
        assert estimate.status == info["status"]
        assert estimate.T_odom_cam is not None
        again = T_world_odom @ estimate.T_odom_cam @ T_cam_body
        np.testing.assert_allclose(again, info["T_estimated"], atol=1e-6)
    before, _, _, _, _ = env.step(np.zeros(2))  # the trial goes on undisturbed
    assert before["left"].shape == (240, 320, 1)


def test_vector_environment_steps_in_parallel(yard):
    envs = gymnasium.make_vec(
        NAV, num_envs=2, vectorization_mode="async", scene=yard, settings=SMALL,
        localization="wheels", vector_kwargs={"context": "spawn"},
    )  # fmt: skip
    try:
        first, _ = envs.reset(seed=[3, 3])
        np.testing.assert_array_equal(first["left"][0], first["left"][1])
        seen, *_ = envs.step(np.array([[0.5, 0.0], [0.0, 0.5]], np.float32))
        for _ in range(5):
            seen, *_ = envs.step(np.array([[0.5, 0.0], [0.0, 0.5]], np.float32))
        assert not np.array_equal(seen["left"][0], seen["left"][1])
    finally:
        envs.close()


def test_two_environments_in_one_process_are_independent(make):
    alone, _ = drive(make(), 3, seed=6)
    a, b = make(), make()
    seen, _ = a.reset(seed=6)
    b.reset(seed=7)
    for (expected, _), _ in zip(alone[1:], range(3), strict=True):
        seen, *_ = a.step(towards(seen["goal"]))
        b.step(np.array([0.2, 0.2]))
        np.testing.assert_array_equal(seen["left"], expected["left"])


def ferry():
    """A yard with a block that waits at (1, 1) and drives to and fro."""
    spec = mujoco.MjSpec.from_string(YARD.replace('file="noise.png"', PLAIN))
    block = spec.worldbody.add_body(name="ferry", mocap=True)
    block.add_geom(name="ferry", type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.3, 0.3, 0.3))
    at = np.eye(4)
    at[:3, 3] = 1.0, 1.0, 0.31

    def motion(time_s):
        T_world_block = at.copy()
        T_world_block[0, 3] += 0.2 * np.sin(time_s)
        return T_world_block

    route = {"default": np.array([[-2.0, 1.5], [2.0, 1.5]])}
    extent = (-3.2, -3.2, 3.2, 3.2)
    return Scene("ferry", "The tests.", spec, route, extent, movers={"ferry": motion})


def test_moving_obstacle_is_no_start_and_a_collision(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "ferry_yard", sys.modules[__name__])
    env = make(scene="ferry_yard:ferry", observe=("goal",))
    with pytest.raises(TrialError, match=r"start \(1, 1\) m: a moving thing is there"):
        env.reset(seed=0, options={"start": (1.0, 1.0, 0.0), "goal": (-2.0, 1.0)})
    for seed in range(15):
        _, info = env.reset(seed=seed, options={"layout": 0})
        assert np.linalg.norm(info["T_true"][:2, 3] - (1.0, 1.0)) > 0.35
    seen, _ = drive(env, options={"start": (-1.0, 1.0, 0.0), "goal": (2.3, 1.0), "layout": 0})
    assert seen[-1][1]["outcome"] == "collision"
    assert seen[-1][1]["contacts"] == ("ferry",)


MEMORY = """
import ctypes, gc, sys, gymnasium, trials.gym
from trials.studies.speed.estimator import resident_mb
env = gymnasium.make("driftyard/RoverNav-v0", disable_env_checker=True, scene=sys.argv[1],
    settings={"rig.width_px": 160, "rig.height_px": 120}, localization="truth")
resident = []
for k in range(16):
    env.reset(options={"layout": k})
    env.step(env.action_space.sample())
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    resident.append(resident_mb())
print(min(resident[12:]) - min(resident[2:6]))
"""


def test_resets_to_other_worlds_do_not_leak_memory(yard):
    result = subprocess.run(
        [sys.executable, "-c", MEMORY, yard], capture_output=True, text=True, check=True
    )
    # MB over ten worlds, without what the allocator keeps for a while, which swings by tens. Ten
    # contexts take more than 200, ten compiled worlds more than 20.
    assert float(result.stdout) < 5
