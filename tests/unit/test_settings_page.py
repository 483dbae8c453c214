"""`driftyard settings` and docs/settings.md."""

import json

import pytest
from terminal import ROOT
from typer.testing import CliRunner

from sim.settings import RecordSettings
from trials.cli.main import app
from trials.cli.settings import MODELS, Kind, page, rows
from vo.config import OdometrySettings
from vo.contract.errors import SettingsError
from vo.contract.settings import keys


def test_settings_page_is_current():
    """`driftyard settings --markdown docs/settings.md` writes it."""
    found = {kind: list(rows(MODELS[kind][0])) for kind in Kind}
    assert (ROOT / "docs/settings.md").read_text("utf-8") == page(found)


@pytest.mark.parametrize("kind", list(Kind))
def test_settings_rows_describe_every_key(kind):
    found = list(rows(MODELS[kind][0]))
    assert [x.key for x in found] == list(keys(MODELS[kind][0]))
    assert [x.key for x in found if not x.description] == []


def test_settings_rows_give_type_default_unit_and_range():
    recording = {x.key: x for x in rows(RecordSettings)}
    tilt = recording["rig.tilt_deg"]
    assert (tilt.type, tilt.unit) == ("float", "°")
    assert float(tilt.default) == RecordSettings().rig.tilt_deg
    assert recording["rig.width_px"].range.startswith("≥ ")
    estimator = {x.key: x for x in rows(OdometrySettings)}
    assert "censure" in estimator["features.detector"].type.split(" | ")
    assert estimator["features.detector"].default == '"censure"'


def test_settings_command_lists_a_prefix():
    runner = CliRunner()
    shown = runner.invoke(app, ["settings", "recording", "rig."])
    assert shown.exit_code == 0
    assert "rig.tilt_deg = " in shown.stdout
    assert "drive." not in shown.stdout.split("\n", 1)[1]
    as_json = json.loads(runner.invoke(app, ["settings", "recording", "rig.", "--json"]).stdout)
    assert {x["key"].partition(".")[0] for x in as_json["recording"]} == {"rig"}
    refused = runner.invoke(app, ["settings", "recording", "wheel"])
    assert isinstance(refused.exception, SettingsError)
    assert "no setting begins with wheel" in str(refused.exception)
