"""Earlier names of modules, programs, commands and options."""

import importlib
import subprocess
import sys
from importlib.util import find_spec

import pytest
from terminal import ROOT

from trials.cli.main import OLD_NAMES, refuse_old_names
from trials.cli.registry import COMMANDS as REGISTERED
from trials.estimators.choice import make_estimator
from trials.execution.runner import ANY_RIG
from trials.moved_modules import moved_modules
from vo.contract.errors import SettingsError


def test_moved_module_is_a_module_or_a_command():
    for old, new in moved_modules().items():
        if new.startswith("`"):
            assert new.strip("`").removeprefix("driftyard ") in REGISTERED, old
        else:
            path = ROOT / new.replace(".", "/")
            assert path.with_suffix(".py").is_file() or (path / "__init__.py").is_file(), old


@pytest.mark.parametrize("old", ["vo.eyes", "trials.systems.orbslam3", "sim.streams"])
def test_import_of_old_module_names_the_new_one(old):
    with pytest.raises(ImportError, match=f"{old.rpartition('.')[0]}.* is now ") as caught:
        importlib.import_module(old)
    assert (moved_modules()[old] + ".").startswith(str(caught.value).rpartition(" ")[2] + ".")


def test_import_of_unknown_module_fails_as_usual():
    with pytest.raises(ModuleNotFoundError, match="No module named"):
        importlib.import_module("vo.nothing")
    assert find_spec("trials.cli") is not None


@pytest.mark.parametrize("old", ["trials.accuracy", "trials.systems.install"])
def test_old_program_names_the_command_and_exits_2(old, tmp_path):
    run = subprocess.run(
        [sys.executable, "-m", old],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2
    assert run.stderr == f"driftyard: error: {old} is now {moved_modules()[old]}\n"


def test_old_plugin_path_names_the_new_module():
    with pytest.raises(SettingsError, match=r"trials\.systems is now trials\.estimators\.systems"):
        make_estimator("trials.systems.orbslam3:OrbSlam3", ANY_RIG)


@pytest.mark.parametrize(("command", "option"), OLD_NAMES)
def test_old_option_names_the_new_one(command, option):
    with pytest.raises(SettingsError, match=f"`driftyard {command} {option}` is now `driftyard"):
        refuse_old_names([command, f"{option}=3"])


def test_old_gate_without_subcommand_names_gate_check():
    with pytest.raises(SettingsError, match="is now `driftyard gate check`"):
        refuse_old_names(["gate", "--baseline", "b.json"])
    for words in ([], ["gate"], ["gate", "--help"], ["gate", "check"], ["drive", "office"]):
        refuse_old_names(words)
