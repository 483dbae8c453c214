"""Cache of recordings and results: paths named after a digest of all that decides the content.

A result depends on settings, on the sources that compute it and on the dataset that it is computed
from. Each of them is a part of the key, so that studies share what they have in common, continue
after an interruption, and compute only what has changed.
"""

import hashlib
import importlib.util
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from vo.contract.dataset import MANIFEST

CACHE = Path("build/cache")
"""Default folder of all recordings and results."""
GENERATOR = ("scenes", "sim", "vo/contract")
"""Sources that decide the content of a recording."""
ESTIMATOR = ("vo", "trials/estimators/baselines", "trials/estimators/systems")
"""Sources that decide the trajectory of an estimator of this repository."""
EVERYTHING = ("scenes", "sim", "vo", "trials")
"""Sources that a worker shares with the command."""
DIGITS = 12
"""Hexadecimal digits of a digest."""


def cache_path(root: Path, kind: str, label: str, *causes: str) -> Path:
    """Return the path of a result in a folder of the cache such as recordings, without a suffix.

    The name begins with the label; the causes, settings as JSON and digests, decide the content.
    """
    return root / kind / f"{label}-{digest(*causes)}"


def digest(*parts: str | bytes) -> str:
    """SHA-256 of texts, shortened to DIGITS."""
    found = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        found.update(len(data).to_bytes(8, "big") + data)
    return found.hexdigest()[:DIGITS]


def source_digest(sources: Sequence[str] = GENERATOR, module: str = "") -> str:
    """Digest of files, folders of Python files, and an importable module, as of a plug-in."""
    root = Path(__file__).resolve().parents[2]
    files = [file for x in sources for file in sorted((root / x).rglob("*.py")) or [root / x]]
    if module:
        with suppress(ImportError, ValueError):  # what imports it says so
            found = importlib.util.find_spec(module)
            files += [Path(found.origin)] if found and found.origin else []
    return digest(*(file.read_bytes() for file in files))


@cache
def code_digest() -> str:
    """Digest of EVERYTHING."""
    return source_digest(EVERYTHING)


def dataset_digest(dataset: Path) -> str:
    """Digest of a dataset: of its manifest, which holds all hashes, or else of its path."""
    manifest = dataset / MANIFEST
    return digest(manifest.read_bytes() if manifest.is_file() else str(dataset.resolve()))
