"""Estimators by name."""

import sys

import pytest

from trials.estimators.baselines.corner_flow import CornerFlow
from trials.estimators.choice import make_estimator
from trials.estimators.plugins import PluginError
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)


OWN = """
import numpy as np
from pydantic import BaseModel, Field
from vo.contract.estimator import Estimate, Status
from vo.contract.settings import Settings

class Standing:
    def __init__(self, rig):
        self.rig = rig

    def track(self, frame):
        return Estimate(frame.timestamp_ns, Status.TRACKED, np.eye(4))

class Tuned(Standing):
    class Settings(Settings):
        gain: float = Field(default=1.0, gt=0)

    def __init__(self, rig, settings):
        self.rig, self.settings = rig, settings

class Lenient(Standing):
    class Settings(BaseModel):
        gain: float = 1.0

class Broken(Standing):
    def __init__(self, rig):
        1 / 0
"""


@pytest.fixture
def own_module(tmp_path, monkeypatch):
    """A module in the working directory, as a user would have it."""
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "unparsable.py").write_text("class X(:\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield
    sys.modules.pop("own", None)


def test_make_estimator_resolves_settings():
    estimator, settings = make_estimator("corner_flow", RIG, None, ["max_corners=77"])
    assert isinstance(estimator, CornerFlow)
    assert settings["max_corners"] == estimator.settings.max_corners == 77
    assert settings["max_hypotheses"] == 300


def test_make_estimator_builds_a_plugin_class():
    estimator, settings = make_estimator("trials.estimators.baselines.corner_flow:CornerFlow", RIG)
    assert isinstance(estimator, CornerFlow)
    assert settings == {}


def test_make_estimator_passes_plugin_settings(own_module, tmp_path):
    (tmp_path / "x.toml").write_text("gain = 3\n")
    assert make_estimator("own:Tuned", RIG)[1] == {"gain": 1.0}
    estimator, settings = make_estimator("own:Tuned", RIG, tmp_path / "x.toml")
    assert settings == {"gain": 3.0}
    assert (estimator.rig, estimator.settings.gain) == (RIG, 3.0)
    assert make_estimator("own:Tuned", RIG, None, ["gain=4"])[1] == {"gain": 4.0}


def test_make_estimator_reads_a_settings_file(tmp_path):
    (tmp_path / "x.toml").write_text("max_corners = 50\nseed = 3\n")
    _, settings = make_estimator("corner_flow", RIG, tmp_path / "x.toml", ["seed=4"])
    assert (settings["max_corners"], settings["seed"]) == (50, 4)


@pytest.mark.parametrize(
    ("name", "overrides", "message"),
    [
        ("orb", [], "unknown estimator orb; valid: corner_flow, driftyard,.* or module:Class"),
        ("nowhere:Thing", [], "cannot import nowhere"),
        ("trials.evaluation.metrics:Thing", [], "has no class Thing with a method track"),
        ("trials.evaluation.alignment:Pair", [], "has no class Pair with a method track"),
        ("trials.evaluation.alignment:", [], "has no class"),
        (":", [], "cannot import"),
        (
            "trials.estimators.baselines.corner_flow:CornerFlow",
            ["a=1"],
            "has no Settings, so takes no --set",
        ),
        ("own:Tuned", ["gian=2"], "unknown setting gian; valid here: gain"),
        ("own:Tuned", ["gain=-2"], "setting gain"),
        ("own:Lenient", [], "its Settings must refuse unknown keys"),
        ("own:Broken", [], r"own:Broken: cannot be built \(ZeroDivisionError: division by zero\)"),
        ("unparsable:X", [], "cannot import unparsable"),
        ("corner_flow", ["corners=1"], "unknown setting corners; valid here: inlier_px"),
        ("corner_flow", ["quality=nan"], "quality"),
        ("corner_flow", ["quality"], "expected key=value"),
        ("driftyard", ["nonsense=1"], "unknown setting nonsense; valid here: budget_ms"),
    ],
)
def test_make_estimator_mistake_names_the_choices(name, overrides, message, own_module):
    with pytest.raises((SettingsError, PluginError), match=message):
        make_estimator(name, RIG, None, overrides)
