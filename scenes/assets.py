"""The files that a custom scene is made from, each with its hash."""

import hashlib
import html
import os
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

from vo.contract.packages import is_own

NAMES = re.compile(rb"""\b(file\w*|(?:mesh|texture|asset)dir)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
"""Attributes of MJCF and URDF that hold the name of a file, or a folder of files."""
XML = (".xml", ".mjcf", ".urdf")
"""Suffixes of files that may name further ones."""


def mjcf_assets(path: Path) -> dict[str, str]:
    """Hash an MJCF file and all files that it names, directly or in what it includes.

    A name is sought wherever MuJoCo may look for it: beside each of the files, and in the folders
    for meshes and textures. The keys are paths from the folder of the first file.
    """
    files, names, folders = [path], set[str](), {""}
    for file in files:  # grows
        if file.suffix.lower() in XML:
            for attribute, *quoted in NAMES.findall(file.read_bytes()):
                text = html.unescape(b"".join(quoted).decode("utf-8", "replace"))
                if attribute.startswith(b"file"):
                    names |= {text, Path(text).name}
                else:
                    folders.add(text)
        beside = {x.parent for x in files if x.suffix.lower() in XML}
        found = (x / folder / name for x in beside for folder in folders for name in names)
        files += sorted({x for x in map(_normal, found) if x.is_file()} - {*map(_normal, files)})
    return _hashes(files, path.parent)


def module_assets(module: ModuleType) -> dict[str, str]:
    """Hash the file of a user's module, and those below its folder that it imports."""
    modules = [module]
    folder = Path(module.__file__ or "").parent
    for user in modules:  # grows
        for value in vars(user).values():
            used = value if isinstance(value, ModuleType) else _origin(value)
            if used and used not in modules and _is_theirs(used, folder):
                modules.append(used)
    return _hashes([Path(x.__file__) for x in modules if x.__file__], folder)


def _origin(value: object) -> ModuleType | None:
    name = getattr(value, "__module__", None)
    return sys.modules.get(name) if isinstance(name, str) else None


def _is_theirs(module: ModuleType, folder: Path) -> bool:
    """Whether a module is a user's own: below a folder, not installed, and none of ours."""
    file = Path(getattr(module, "__file__", None) or "/")
    ours = is_own(module.__name__)
    return file.is_relative_to(folder) and "site-packages" not in file.parts and not ours


def _normal(path: Path) -> Path:
    return Path(os.path.normpath(path))


def _hashes(files: Iterable[Path], folder: Path) -> dict[str, str]:
    return {
        Path(os.path.relpath(file, folder)).as_posix(): hashlib.sha256(
            file.read_bytes()
        ).hexdigest()
        for file in files
    }
