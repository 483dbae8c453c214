"""Virtual environments of odometry systems by other authors."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from vo.contract.errors import DriftyardError, SettingsError

FOLDER_VARIABLE = "DRIFTYARD_SYSTEMS"
"""Environment variable that names the folder of the environments."""


class ForeignSystemError(DriftyardError):
    """A system is not installed, or cannot be."""


@dataclass(frozen=True)
class Package:
    """Pinned requirements of a system for pip, what else it needs, and its license."""

    requirements: tuple[str, ...]
    needs: str
    license: str


SYSTEMS = {
    "orbslam3": Package(
        ("pyorbslam3==0.1.1",),
        "Debian's libgl1 libegl1 libopengl0 libsm6 libice6; a vocabulary, --set vocabulary=FILE",
        "GPL-3.0",
    ),
    "toy_vo": Package(("toy-vo==0.1.1",), "nothing else", "GPL-2.0-or-later"),
}


def folder_of(system: str) -> Path:
    """Return the folder of a system, which may not exist; SettingsError if it is unknown."""
    if system not in SYSTEMS:
        raise SettingsError(f"unknown system {system}; valid: {', '.join(SYSTEMS)}")
    default = Path.home() / ".cache" / "driftyard" / "systems"
    return Path(os.environ.get(FOLDER_VARIABLE, default)) / system


def python_of(system: str) -> Path:
    """Return the interpreter of a system; ForeignSystemError if it is not installed."""
    python = folder_of(system) / "bin" / "python"
    if not python.exists():
        raise ForeignSystemError(
            f"{system} is not installed; `driftyard systems install {system}` installs it in "
            f"{folder_of(system)}"
        )
    return python


def install(system: str) -> Path:
    """Create a system's environment, return its interpreter; ForeignSystemError if pip fails."""
    folder, package = folder_of(system), SYSTEMS[system]
    python = folder / "bin" / "python"
    steps = (
        (sys.executable, "-m", "venv", "--clear", str(folder)),
        (str(python), "-m", "pip", "install", "--quiet", *package.requirements),
    )
    for step in steps:
        done = subprocess.run(step, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise ForeignSystemError(f"cannot install {system}: {last}")
    return python
