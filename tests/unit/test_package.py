"""The package as it is installed: its packages, types and version."""

import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from terminal import ROOT
from test_structure import PACKAGES

import driftyard

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """Wheel and source distribution, built without isolation and so without network."""
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "--directory", str(out)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,), (source,) = out.glob("*.whl"), out.glob("*.tar.gz")
    return wheel, source


def packaged_files() -> set[str]:
    return {
        str(x.relative_to(ROOT))
        for package in PACKAGES
        for x in (ROOT / package).rglob("*")
        if x.is_file() and "__pycache__" not in x.parts
    }


def test_wheel_is_small_and_has_every_file_of_the_packages(distributions):
    wheel, _ = distributions
    files = set(zipfile.ZipFile(wheel).namelist())
    assert wheel.stat().st_size < 3e6
    assert {x for x in files if ".dist-info/" not in x} == packaged_files()


def test_source_distribution_has_what_its_wheel_needs(distributions):
    with tarfile.open(distributions[1]) as source:
        files = {str(Path(*Path(x).parts[1:])) for x in source.getnames()}
    assert packaged_files() <= files
    assert {"pyproject.toml", "README.md", "LICENSE", "PKG-INFO"} <= files


def test_public_types_are_known():
    command = [sys.executable, "-m", "basedpyright", "--pythonpath", sys.executable]
    command += ["--verifytypes", "driftyard", "--ignoreexternal", "--outputjson"]
    here = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, env=here, capture_output=True, text=True)
    found = json.loads(done.stdout)["typeCompleteness"]
    assert found["packageRootDirectory"] == str(ROOT / "driftyard")
    # Matplotlib states no types that a type checker takes from a package; PyTorch is not installed.
    unknown = [x["name"] for x in found["symbols"] if x["isExported"] and not x["isTypeKnown"]]
    assert [x for x in unknown if ".Plot" not in x and ".torch." not in x] == []
    assert found["completenessScore"] > 0.98


def test_wheel_has_every_package_with_its_types():
    assert set(PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]) == set(PACKAGES)
    assert [x for x in PACKAGES if not (ROOT / x / "py.typed").is_file()] == []


def test_version_is_written_once():
    assert "version" not in PROJECT["project"]
    (source,) = PROJECT["tool"]["hatch"]["version"].values()
    (written,) = re.findall(r'^__version__ = "(.*)"$', (ROOT / source).read_text(), re.MULTILINE)
    assert written == driftyard.__version__
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*", written)


def test_command_line_prints_the_version():
    command = [sys.executable, "-m", "trials.cli", "--version"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == f"driftyard {driftyard.__version__}\n"


def test_installation_page_lists_every_extra():
    rows = re.findall(r"^\| `(\w+)` \|", (ROOT / "docs/install.md").read_text(), re.MULTILINE)
    assert rows == sorted(PROJECT["project"]["optional-dependencies"])
