"""Eclipse SUMO, which is imported when it is used: it is optional."""

import os
import subprocess
from importlib import import_module
from pathlib import Path
from typing import Any

from vo.contract.errors import DriftyardError, SettingsError


class TrafficError(DriftyardError):
    """A message of Eclipse SUMO that ends a simulation."""


def require_sumo() -> tuple[Any, Path]:
    """Import libsumo; return it and the folder of SUMO's programs.

    Raises:
        SettingsError: If a package is missing; names the extra.
    """
    try:
        return import_module("libsumo"), Path(import_module("sumo").SUMO_HOME) / "bin"
    except ImportError as error:
        raise SettingsError(
            f"the traffic simulation needs Eclipse SUMO ({error.name or error} is missing): "
            'pip install "driftyard[traffic]"'
        ) from None


def convert_network(nodes: Path, edges: Path, connections: Path, out: Path) -> None:
    """Convert a plain description of a network into SUMO's format.

    Raises:
        TrafficError: If netconvert refuses it.
    """
    _, programs = require_sumo()
    words = [programs / "netconvert", "-n", nodes, "-e", edges, "-x", connections, "-o", out]
    environment = {**os.environ, "SUMO_HOME": str(programs.parent)}
    done = subprocess.run(
        [*map(str, words), "--no-turnarounds", "--no-warnings"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise TrafficError(f"netconvert: {done.stderr.strip() or done.returncode}")
