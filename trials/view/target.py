"""Target of a view: a window, the address of a viewer, or a file."""

import importlib.util
import os
import re
import socket
import sys
from dataclasses import dataclass
from pathlib import Path

from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix

SUFFIX = ".rrd"
PORT = 9876
"""Port at which a viewer listens by default."""
URL = re.compile(r"rerun(\+https?)?://(?P<host>\[[^\]]+\]|[^/:\s]+):(?P<port>\d{1,5})/proxy")
EXAMPLE = "rerun+http://127.0.0.1:9876/proxy"
CONNECT_S = 3.0


@dataclass(frozen=True)
class Target:
    """A file, or the address of a viewer; with neither, a window that is opened."""

    file: Path | None = None
    url: str | None = None


def require_viewer() -> None:
    """Raise a SettingsError if the package of the viewer is missing."""
    if importlib.util.find_spec("rerun_bindings") is None:
        raise SettingsError('the viewer needs the package rerun-sdk: pip install "driftyard[view]"')


def target_of(to: str | os.PathLike[str] | None) -> Target:
    """Return the target of a file's name or an address; of None, the viewer of this machine.

    Raises:
        SettingsError: If the package of the viewer is missing, the name does not end in .rrd,
            the address is malformed, nothing listens there, or there is no display.
    """
    if importlib.util.find_spec("rerun_bindings") is None:
        raise SettingsError('the viewer needs the package rerun-sdk: pip install "driftyard[view]"')
    if isinstance(to, str) and "://" in to:
        parts = URL.fullmatch(to)
        if parts is None:
            raise SettingsError(f"{to}: expected the address of a viewer, as {EXAMPLE}")
        if not listens(parts["host"].strip("[]"), int(parts["port"])):
            raise SettingsError(f"{to}: no viewer listens there; start one with `rerun`")
        return Target(url=to)
    if to is not None:
        known_suffix(Path(to), (SUFFIX,))
        return Target(Path(to))
    if listens("127.0.0.1", PORT):
        return Target(url=EXAMPLE)
    if sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
        raise SettingsError(
            "there is no display for the viewer: write a file with --save FILE.rrd and open it "
            "with `rerun FILE.rrd` elsewhere, or give the address of a viewer with --connect"
        )
    return Target()


def listens(host: str, port: int) -> bool:
    """Whether a program accepts connections at a port."""
    try:
        socket.create_connection((host, port), CONNECT_S).close()
    except (OSError, OverflowError, UnicodeError):
        return False
    return True
