"""The navigator drives around unknown obstacles and recovers from false ones."""

import gymnasium
import numpy as np
import pytest
from gym_worlds import write_yard

import trials.gym  # noqa: F401, registers the environments
from trials.gym.env.policies import NavigatorPolicy
from trials.navigation.navigator import Navigator
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import Pose2, SteeringSettings

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def env(tmp_path_factory):
    env = gymnasium.make(
        "driftyard/RoverNav-v0",
        disable_env_checker=True,
        scene=str(write_yard(tmp_path_factory.mktemp("navigator"))),
        settings={"rig.width_px": 320, "rig.height_px": 240, "render.samples": 0},
        localization="truth",
        observe=NavigatorPolicy.NEEDS,
        rate_hz=10.0,
        time_limit_s=90.0,
    )
    yield env
    env.close()


def drive(env, policy, observation, steps=900):
    info = {}
    for _ in range(steps):
        observation, _, terminated, truncated, info = env.step(policy.act(observation))
        if terminated or truncated:
            break
    return info


def test_navigator_drives_around_the_pillar(env):
    options = {"start": (-2.0, 0.0, 0.0), "goal": (2.0, 0.0)}
    observation, _ = env.reset(seed=0, options=options)
    policy = NavigatorPolicy(env.unwrapped)
    info = drive(env, policy, observation)
    assert info["outcome"] == "success"
    assert info["contacts"] == ()
    assert 4.0 - 0.3 < info["driven_m"] < 6.0
    grid = policy.navigator.grid
    near_side = [grid.log_odds[grid.cell(x, 0.0)] for x in (-0.5, -0.4, -0.3, -0.2)]
    assert max(near_side) > 1.0
    assert grid.log_odds[grid.cell(-1.2, 0.0)] < 0.0  # the ground before it


def test_navigator_turns_for_a_goal_behind(env):
    options = {"start": (-1.5, 1.8, 0.0), "goal": (-2.0, -1.8)}
    observation, _ = env.reset(seed=0, options=options)
    settings = NavigatorSettings(initial_turn_deg=0.0)
    policy = NavigatorPolicy(env.unwrapped, settings)
    assert drive(env, policy, observation)["outcome"] == "success"


def test_navigator_behind_a_false_wall_backs_off(env):
    env.reset(seed=0)
    rig = env.unwrapped.instance.camera.rig
    settings = NavigatorSettings(initial_turn_deg=0.0, stuck_timeout_s=2.0, back_off_duration_s=0.5)
    navigator = Navigator(rig, SteeringSettings(period_s=0.1), settings)
    pose, goal = Pose2(0.0, 0.0, 0.0), np.array([3.0, 0.0])
    # The same wall, 0.6 m ahead, in every image, whatever the rover does.
    wall = np.full((120, 160), rig.f_px * rig.baseline_m / 0.6)
    twists = [navigator.act(wall, pose, goal) for _ in range(60)]
    assert navigator.back_offs >= 2
    assert min(t.forward_mps for t in twists) == pytest.approx(-0.15)
    backwards = [k for k, t in enumerate(twists) if t.forward_mps < 0]
    assert 19 <= backwards[0] <= 21  # after two seconds of patience
    blind = np.zeros_like(wall)
    navigator = Navigator(rig, SteeringSettings(period_s=0.1), settings)
    assert navigator.act(blind, pose, goal).forward_mps > 0  # nothing known: nothing in the way


def test_navigator_at_the_goal_stands(env):
    env.reset(seed=0)
    rig = env.unwrapped.instance.camera.rig
    navigator = Navigator(rig, SteeringSettings(period_s=0.1))
    twist = navigator.act(np.zeros((120, 160)), Pose2(1.0, 1.0, 0.3), np.array([1.05, 1.0]))
    assert twist == (0.0, 0.0)
