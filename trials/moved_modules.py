"""Earlier names of modules: importing one raises an error that names the new one."""

import sys
from collections.abc import Sequence
from functools import cache
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

TABLE = Path(__file__).with_suffix(".txt")
"""A line for each module that moved: its earlier name, then its present one or the command."""


@cache
def moved_modules() -> dict[str, str]:
    """Return the present name, or the command in backquotes, of every earlier name."""
    lines = TABLE.read_text().splitlines()
    return dict(line.split(maxsplit=1) for line in lines)


class MovedModules:
    """Finder of last resort on `sys.meta_path`, for modules that no other finder knows."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find nothing.

        Raises:
            ImportError: If the module has moved; names the present one.
            SystemExit: Likewise, with status 2, for `python -m NAME`.
        """
        new = moved_modules().get(name)
        if not new:
            return None
        if sys.argv[:1] == ["-m"]:  # as long as `python -m` looks for the module
            asked = sys.orig_argv[sys.orig_argv.index("-m") + 1]
            new = moved_modules().get(asked, new)
            print(f"driftyard: error: {asked} is now {new}", file=sys.stderr)
            raise SystemExit(2)
        raise ImportError(f"{name} is now {new}", name=name)


def install() -> None:
    """Let imports of earlier names fail with the present ones."""
    if not any(isinstance(x, MovedModules) for x in sys.meta_path):
        sys.meta_path.append(MovedModules())
