"""The pages of the environments say what the code says."""

import re

import gymnasium
import numpy as np
import pytest
from terminal import ROOT

import trials.gym
from trials.cli.settings import rows, table
from trials.gym.env.environments import RoverExplore, RoverNav, RoverRoute
from trials.gym.env.tasks import FAILURE, STEP, SUCCESS

CLASSES = dict(zip(trials.gym.ENVIRONMENTS, (RoverNav, RoverRoute, RoverExplore), strict=True))
CHANNELS = ("left", "right", "disparity", "pose", "encoders", "imu", "goal")
EDGES = {"-2^40": -(2**40), "2^40": 2**40}


@pytest.fixture(params=CLASSES)
def name(request) -> str:
    return request.param


@pytest.fixture
def page(name) -> str:
    stem = re.sub(r".*Rover(\w+)-v0", r"rover_\1", name).lower()
    return (ROOT / f"docs/environments/{stem}.md").read_text("utf-8")


def cells(page: str, heading: str) -> list[list[str]]:
    """Rows of the first table under a heading, without its head; code is unquoted."""
    lines = page.split(f"\n## {heading}\n")[1].split("\n## ")[0].splitlines()
    found = [line.strip("| ").split(" | ") for line in lines if line.startswith("|")]
    return [[cell.strip().strip("`") for cell in row] for row in found[2:]]


def bounds(cell: str) -> list[float]:
    return [float(EDGES.get(x, x)) for x in cell.split(", ")]


def test_page_states_spaces_and_spec(name, page):
    env, spec = CLASSES[name](), gymnasium.spec(name)
    assert f"`{env.action_space}`" in page
    assert f"`{env.observation_space}`" in page
    assert f"(`max_episode_steps`) | {spec.max_episode_steps} |" in page
    assert f"(`reward_threshold`) | {spec.reward_threshold:g} |" in page
    assert f'gymnasium.make("driftyard:{name}")' in page


def test_page_lists_the_arguments(name, page):
    assert "\n".join(table(rows(CLASSES[name].model))) in page


def test_page_lists_the_channels_and_bounds(name, page):
    spaces = CLASSES[name](observe=CHANNELS).observation_space
    found = {row[0]: row[1:] for row in cells(page, "Observation space")}
    assert tuple(found) == CHANNELS
    for channel, (shape, dtype, low, high, _) in found.items():
        space = spaces[channel]
        assert (shape, dtype) == (str(space.shape), str(space.dtype))
        for said, values in ((low, space.low), (high, space.high)):
            np.testing.assert_allclose(bounds(said), list(dict.fromkeys(values.ravel())), rtol=1e-5)


def test_page_states_actions_and_rewards(name, page):
    actions = CLASSES[name]().action_space
    for k, row in enumerate(cells(page, "Action space")):
        assert (float(row[-2]), float(row[-1])) == (actions.low[k], actions.high[k])
    rewards = {row[0]: row[1].split(",")[0] for row in cells(page, "Rewards")}
    for part, value in (("step", STEP), ("success", SUCCESS), ("failure", FAILURE)):
        assert float(rewards[part]) == value
