"""Estimators by name."""

import pytest

from trials.baselines.corner_flow import CornerFlow
from trials.estimators import ESTIMATORS, make_estimator
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)


def test_settings_arrive_and_are_resolved():
    estimator, settings = make_estimator("corner_flow", RIG, None, ["max_corners=77"])
    assert isinstance(estimator, CornerFlow)
    assert settings["max_corners"] == estimator.settings.max_corners == 77
    assert settings["trials"] == 300


def test_a_class_of_ones_own():
    estimator, settings = make_estimator("trials.baselines.corner_flow:CornerFlow", RIG)
    assert isinstance(estimator, CornerFlow)
    assert settings == {}


def test_a_file_of_settings(tmp_path):
    (tmp_path / "x.toml").write_text("max_corners = 50\nseed = 3\n")
    _, settings = make_estimator("corner_flow", RIG, tmp_path / "x.toml", ["seed=4"])
    assert (settings["max_corners"], settings["seed"]) == (50, 4)


@pytest.mark.parametrize(
    ("name", "overrides", "message"),
    [
        ("orb", [], "unknown estimator orb; valid: corner_flow, driftyard, or module:Class"),
        ("nowhere:Thing", [], "cannot import nowhere"),
        ("trials.metrics:Thing", [], "has no class Thing with a method track"),
        ("trials.alignment:Pair", [], "has no class Pair with a method track"),
        ("trials.alignment:", [], "has no class"),
        (":", [], "cannot import"),
        ("trials.baselines.corner_flow:CornerFlow", ["a=1"], "--set and --config are for"),
        ("corner_flow", ["corners=1"], "unknown setting corners; valid here: inlier_px"),
        ("corner_flow", ["quality=nan"], "quality"),
        ("corner_flow", ["quality"], "expected key=value"),
        ("driftyard", ["nonsense=1"], "unknown setting nonsense; valid here: features"),
    ],
)
def test_mistakes_name_the_choices(name, overrides, message):
    with pytest.raises(SettingsError, match=message):
        make_estimator(name, RIG, None, overrides)


def test_the_registry_is_what_the_help_says():
    assert list(ESTIMATORS) == ["driftyard", "corner_flow"]
