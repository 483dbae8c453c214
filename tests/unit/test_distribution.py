"""Files for those who install, cite or report: they agree with the project."""

import json
import re
import tomllib

import pytest
import yaml
from terminal import ROOT

import driftyard

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_citation_states_the_version_and_licence():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert str(citation["version"]) == driftyard.__version__
    assert citation["license"] == PROJECT["license"]
    assert citation["keywords"] == PROJECT["keywords"]
    assert citation["authors"] == PROJECT["authors"]


def test_container_installs_the_driver_of_the_setup():
    packages = re.search(r"install_system (libegl1 .*)", (ROOT / ".ci/setup").read_text())
    assert packages is not None
    assert f"--no-install-recommends {packages[1]} " in (ROOT / "Dockerfile").read_text()


def test_development_container_calls_the_setup():
    made = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text())
    assert made["postCreateCommand"].startswith("sh .ci/setup .venv")


@pytest.mark.parametrize("name", ["bug_report", "feature_request"])
def test_issue_form_asks_for_something(name):
    form = yaml.safe_load((ROOT / f".github/ISSUE_TEMPLATE/{name}.yml").read_text())
    assert {"name", "description", "body"} <= form.keys()
    required = [x["id"] for x in form["body"] if x.get("validations", {}).get("required")]
    assert required
