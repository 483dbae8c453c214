"""The package as it is installed: its packages, types and version."""

import re
import subprocess
import sys
import tomllib

from terminal import ROOT
from test_structure import PACKAGES

import driftyard

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


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
