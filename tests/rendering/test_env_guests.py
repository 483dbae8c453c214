"""Third-party tools with the environments, where they are installed."""

import gymnasium
import pytest
from gym_worlds import write_yard

import trials.gym

pytestmark = pytest.mark.gl

NAV = next(iter(trials.gym.ENVIRONMENTS))


def make(folder, **options):
    scene = str(write_yard(folder))
    small = {"rig.width_px": 64, "rig.height_px": 48, "render.samples": 0}
    return gymnasium.make(NAV, scene=scene, settings=small, localization="truth", **options)


def test_environment_in_gymnasium_records_video(tmp_path):
    pytest.importorskip("moviepy")
    from gymnasium.wrappers import RecordVideo

    env = RecordVideo(make(tmp_path, render_mode="rgb_array"), str(tmp_path / "films"))
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    env.close()
    assert [film.suffix for film in (tmp_path / "films").iterdir() if film.suffix == ".mp4"]


def test_environment_in_stable_baselines_learns(tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    env = make(tmp_path, observe=("goal",), layout=0)
    before = sb3.PPO("MultiInputPolicy", env, n_steps=64, batch_size=32, seed=0, device="cpu")
    weights = [p.detach().clone() for p in before.policy.parameters()]
    before.learn(128)
    after = list(before.policy.parameters())
    assert any((a != b).any() for a, b in zip(weights, after, strict=True))
    env.close()
