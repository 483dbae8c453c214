"""History of a project's gate: a file of JSON lines, to which every check appends a record."""

import hashlib
import json
import os
import subprocess
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import AwareDatetime

from trials.gate.comparison import Comparison
from trials.gate.reports import as_json
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.files import read_lines
from vo.contract.settings import Settings, validated

KIND, SCHEMA_VERSION = "driftyard gate record", 1
SUFFIX = ".jsonl"


class FigureRecord(Settings):
    """A figure of a check; unknown numbers are None."""

    verdict: str
    baseline: float | None
    now: float | None
    ratio: float | None = None
    """Increase, the mean over scenes."""
    bounds: tuple[float | None, float | None] = (None, None)
    """Confidence bounds of the ratio."""


class SceneRecord(Settings):
    """Change of the drift in a scene; unknown numbers are None."""

    scene: str
    sequences: int
    """Number of sequences that neither estimator loses."""
    newly_lost: int
    drift_percent: float | None
    """Drift of the baseline."""
    ratio: float | None
    p: float | None
    q: float | None
    verdict: str


class CheckRecord(Settings):
    """One check of the gate."""

    kind: Literal["driftyard gate record"] = KIND
    schema_version: Literal[1] = SCHEMA_VERSION
    commit: str = ""
    """Commit of the estimator; empty if unknown."""
    committed: AwareDatetime | None = None
    """Time of the commit."""
    has_changes: bool = False
    """Whether tracked files differed from the commit."""
    checked: AwareDatetime
    """Time of the check."""
    estimator: str
    baseline: str
    """Estimator of the baseline."""
    sequences: str
    """Digest of the sequences; levels are comparable while it stays."""
    number: int
    """Number of sequences."""
    verdict: str
    why: str
    figures: Mapping[str, FigureRecord]
    scenes: tuple[SceneRecord, ...] = ()

    @property
    def time(self) -> datetime:
        """Time of the commit, or else of the check."""
        return self.committed or self.checked

    @property
    def regressed(self) -> list[str]:
        """Scenes whose drift regressed, or all of whose sequences are newly lost."""
        return [x.scene for x in self.scenes if x.verdict]


def record_of(found: Comparison, commit: str = "") -> CheckRecord:
    """Make the record of a check, at a commit or the one that is checked out here."""
    about = json.loads(as_json(found))
    hashes = "".join(x.sha256 for x in found.baseline.sequences)
    figures = {
        x["figure"]: {k: x[k] for k in ("verdict", "baseline", "now")}
        | {k: x["change"][k] for k in ("ratio", "bounds") if x["change"]}
        for x in about["findings"]
    }
    content: dict[str, Any] = {
        **_revision(commit),
        "checked": datetime.now(UTC).replace(microsecond=0),
        "estimator": found.estimator,
        "baseline": found.baseline.estimator,
        "sequences": hashlib.sha256(hashes.encode()).hexdigest()[:12],
        "number": len(found.measured),
        "verdict": about["verdict"],
        "why": about["why"],
        "figures": figures,
        "scenes": about["scenes"],
    }
    return validated(CheckRecord, content)


def _revision(commit: str) -> dict[str, Any]:
    """Return hash, time and state of a commit of the repository here, as far as Git knows them."""
    known = _git("log", "-1", "--format=%H %cI", commit or "HEAD", "--")
    if not known:
        return {"commit": commit}
    name, time = known.split()
    has_changes = not commit and bool(_git("status", "--porcelain", "--untracked-files=no"))
    return {"commit": name, "committed": time, "has_changes": has_changes}


def _git(*words: str) -> str:
    try:
        done = subprocess.run(["git", *words], capture_output=True, text=True, check=False)
    except OSError:  # it is not installed
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def append_record(path: Path, record: CheckRecord) -> None:
    """Append a record in one write, so that checks may do so at once; DatasetError if it cannot."""
    line = (record.model_dump_json() + "\n").encode()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab+") as file:
            if file.tell():
                file.seek(-1, os.SEEK_END)
                line = line if file.read() == b"\n" else b"\n" + line  # a write was interrupted
            file.write(line)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be written ({error.strerror})") from None


def check_history(path: Path) -> None:
    """Raise DriftyardError if a record cannot be appended: no history, or damaged."""
    if path.suffix != SUFFIX:
        raise SettingsError(f"{path}: the name of a history must end in {SUFFIX}")
    if path.exists():
        _read_file(path)


def read_history(paths: Iterable[Path]) -> list[CheckRecord]:
    """Read the records of files, and of all .jsonl files in folders, the oldest first.

    Records that several files share are taken once.

    Raises:
        DatasetError: If a file is missing or a line is no record, or there are no records; names
            file and line.
    """
    found: dict[str, CheckRecord] = {}
    names: list[str] = []
    for path in paths:
        names.append(str(path))
        for file in sorted(path.rglob(f"*{SUFFIX}")) if path.is_dir() else [path]:
            found |= {x.model_dump_json(): x for x in _read_file(file)}
    if not found:
        raise DatasetError(
            f"{', '.join(names)}: no records; `driftyard gate check --history FILE{SUFFIX}` "
            "appends them"
        )
    return sorted(found.values(), key=lambda x: (x.time, x.checked))


def _read_file(path: Path) -> list[CheckRecord]:
    records: list[CheckRecord] = []
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip():
            continue
        try:
            content = json.loads(line)
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict) or content.get("kind") != KIND:
            raise DatasetError(f"{path}:{number}: not a record of `driftyard gate check --history`")
        if content.get("schema_version") != SCHEMA_VERSION:
            raise DatasetError(
                f"{path}:{number}: record of schema {content.get('schema_version')}, this program "
                f"reads {SCHEMA_VERSION}"
            )
        try:
            records.append(validated(CheckRecord, content))
        except SettingsError as error:
            raise DatasetError(f"{path}:{number}: {error}") from None
    return records
