"""The environments keep Gymnasium's conventions: specs, wrappers, vectors, workers."""

import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gym_worlds import write_yard
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec
from terminal import ROOT

import trials.gym
from sim.camera.gl import open_context
from sim.graphics import GraphicsError
from trials.gym.media import Filmed

pytestmark = pytest.mark.gl

TINY = {"rig.width_px": 64, "rig.height_px": 48, "render.samples": 0}
NAMES = tuple(trials.gym.ENVIRONMENTS)
NAV = NAMES[0]
AT_REST = np.zeros(2, np.float32)


@pytest.fixture(scope="module")
def options(tmp_path_factory):
    yard = str(write_yard(tmp_path_factory.mktemp("manners")))
    return {"scene": yard, "settings": TINY, "localization": "wheels", "rate_hz": 5.0}


@pytest.fixture
def make(options):
    made = []

    def build(name: str = NAV, **changes):
        made.append(gymnasium.make(f"driftyard:{name}", **{**options, **changes}))
        return made[-1]

    yield build
    for env in made:
        env.close()
        env.close()


def test_registered_specs_are_complete():
    for name in NAMES:
        spec = gymnasium.spec(name)
        assert spec.max_episode_steps == 1800
        assert spec.reward_threshold is not None
        assert spec.nondeterministic is False
        assert EnvSpec.from_json(spec.to_json()) == spec
    assert all(name in gymnasium.pprint_registry(disable_print=True) for name in NAMES)


@pytest.mark.parametrize(
    ("changes", "steps"),
    [
        ({}, 600),
        ({"rate_hz": 15.0}, 1800),
        ({"rate_hz": 100.0}, 12_000),  # more than the registered limit
        ({"time_limit_s": 0.7}, 4),
        ({"max_episode_steps": 3}, 3),
        ({"max_episode_steps": -1}, None),
    ],
)
def test_limit_of_steps_follows_the_options(make, changes, steps):
    env = make(**changes)
    assert env.spec.max_episode_steps == steps
    assert gymnasium.make(env.spec).spec == env.spec


def test_environment_is_truncated_at_its_limit(make):
    env = make(time_limit_s=0.6)
    env.reset(seed=0)
    assert [env.step(AT_REST)[3] for _ in range(3)] == [False, False, True]


def test_spec_makes_the_same_environment(make):
    env = make(observe=("left", "goal"), distance_m=(1.0, 3.0))
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    for a, b in zip(env.reset(seed=3)[0].values(), again.reset(seed=3)[0].values(), strict=True):
        np.testing.assert_array_equal(a, b)
    again.close()


def test_film_is_part_of_the_spec(make, tmp_path):
    env = Filmed(make(render_mode="rgb_array"), tmp_path / "trial.mp4")
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert isinstance(again, Filmed)
    assert again.spec.additional_wrappers[-1].kwargs == {"out": str(tmp_path / "trial.mp4")}


def test_one_channel_is_the_observation(make):
    env = make(observe="left")
    both = make(observe=("left", "goal"), scene=Path(env.unwrapped.trial.scene))
    seen, _ = env.reset(seed=1)
    assert env.observation_space == both.observation_space["left"]
    np.testing.assert_array_equal(seen, both.reset(seed=1)[0]["left"])


def test_wrappers_of_images_apply(make):
    env = make(observe="left", settings={**TINY, "rig.color": True}, time_limit_s=0.4)
    grey = wrappers.ResizeObservation(wrappers.GrayscaleObservation(env), (24, 32))
    stacked = wrappers.RecordEpisodeStatistics(wrappers.FrameStackObservation(grey, 3))
    seen, _ = stacked.reset(seed=0)
    assert seen.shape == (3, 24, 32)
    assert seen in stacked.observation_space
    stacked.step(AT_REST)
    *_, info = stacked.step(AT_REST)
    assert info["episode"]["l"] == 2
    assert gymnasium.make(stacked.spec).observation_space == stacked.observation_space


def test_dict_observations_are_stacked_and_flattened(make):
    stacked = wrappers.FrameStackObservation(make(observe=("left", "goal")), 2)
    assert stacked.reset(seed=0)[0] in stacked.observation_space
    flat = wrappers.FlattenObservation(make(observe=("imu", "goal")))
    assert flat.reset(seed=0)[0].shape == (8,)


def test_video_is_recorded(make, tmp_path):
    pytest.importorskip("moviepy")
    env = make(render_mode="rgb_array", time_limit_s=0.4)
    video = wrappers.RecordVideo(env, str(tmp_path / "videos"))
    video.reset(seed=0)
    video.step(AT_REST)
    video.step(AT_REST)
    video.close()
    assert (tmp_path / "videos/rl-video-episode-0.mp4").stat().st_size > 1000


def test_renders_are_collected(make):
    env = make(render_mode="rgb_array_list")
    env.reset(seed=0)
    env.step(AT_REST)
    assert [x.shape for x in env.render()] == [(388, 960, 3)] * 2


def test_what_was_returned_never_changes(make):
    env = make(observe=("left", "pose"), disturb="drop=1.0")
    returned = [env.reset(seed=0), *(env.step(AT_REST)[::4] for _ in range(3))]
    for (a, info_a), (b, info_b) in pairwise(returned):
        for x, y in [(a, b), (info_a, info_b)]:
            arrays = [key for key in x if isinstance(x[key], np.ndarray)]
            assert [key for key in arrays if np.shares_memory(x[key], y[key])] == []


def test_vector_of_one_process_resets_by_itself(options):
    envs = gymnasium.make_vec(NAV, 2, "sync", **options, observe=("left", "goal"), time_limit_s=0.4)
    seen, infos = envs.reset(seed=3)
    assert seen["left"].shape == (2, 48, 64, 1)
    assert infos["T_true"].shape == (2, 4, 4)
    ends = [envs.step(np.zeros((2, 2), np.float32))[3].all() for _ in range(4)]
    assert ends == [False, True, False, False]
    envs.close()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_fork_after_graphics_is_refused(make):
    make(observe="left").reset(seed=0)
    if (child := os.fork()) == 0:  # it must not return into pytest
        try:
            open_context("auto", 64, 48)
        except GraphicsError as error:
            os._exit("spawn" in str(error))
        finally:
            os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 1


def test_triton_loads_after_graphics():
    """PyTorch loads it with the first optimizer, which may be made after a reset."""
    pytest.importorskip("triton")
    code = "from sim.camera.gl import open_context; import mujoco as m;"
    code += "c = open_context('auto', 64, 48); w = m.MjModel.from_xml_string('<mujoco/>');"
    code += "m.MjrContext(w, m.mjtFontScale.mjFONTSCALE_100); import triton"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("error")
def test_checks_of_stable_baselines_pass(make, name):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(make(name, render_mode="rgb_array"))


@pytest.mark.parametrize("name", NAMES)
def test_pages_list_the_information(make, name):
    _, info = make(name, observe="goal").reset(seed=0)
    page = ROOT / f"docs/environments/rover_{name[15:-3].lower()}.md"
    listed = page.read_text("utf-8").split("## Information")[1].split("## Version")[0]
    assert re.findall(r"^\| `(\w+)`", listed, re.MULTILINE) == list(info)
