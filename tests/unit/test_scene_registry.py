"""The registry: what can be known without building, and refusals that name the choices."""

import numpy as np
import pytest

from scenes import SCENES, build_scene
from vo.contract.errors import SettingsError


def test_registry_entries_describe_themselves_in_a_sentence():
    for entry in SCENES.values():
        assert entry.tests.endswith(".")
        assert "\n" not in entry.tests


@pytest.mark.parametrize("name", SCENES)
def test_registry_options_all_have_defaults(name):
    SCENES[name].options()


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("moon", {}, ["moon", "brick_court", "office"]),
        ("brick_court", {"gap": 3}, ["gap", "gap_mm", "height_std_mm", "bond"]),
        ("brick_court", {"gap_mm": -1}, ["gap_mm", "-1", "greater"]),
        ("brick_court", {"bond": "flemish"}, ["bond", "flemish", "herringbone"]),
        ("office", {"length_m": "wide"}, ["length_m", "wide"]),
    ],
)
def test_build_scene_bad_option_is_one_line_with_the_choices(name, options, words):
    with pytest.raises(SettingsError) as refusal:
        build_scene(name, np.random.default_rng(0), options)
    message = str(refusal.value)
    assert "\n" not in message
    for word in words:
        assert word in message
