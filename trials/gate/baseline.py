"""Baseline file: measurements, sequences, software and rules of the decision."""

import json
import platform
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from trials.gate.design import Design
from trials.gate.measurement import Measurement
from trials.gate.rules import Rules
from vo.contract.errors import DatasetError
from vo.contract.files import write_text
from vo.contract.settings import Settings, validated

KIND, SCHEMA_VERSION = "driftyard gate baseline", 1
MISMATCHES = ("datasets", "platform")
"""Differences from the baseline that must be accepted explicitly."""


class Recorded(Settings):
    """Measurement of one sequence."""

    scene: str
    seed: int
    sha256: str
    """Hash of the contents of the dataset."""
    measured: Measurement


class Baseline(Settings):
    """Measurements that a candidate is compared with."""

    kind: Literal["driftyard gate baseline"] = KIND
    schema_version: Literal[1] = SCHEMA_VERSION
    estimator: str
    settings: Mapping[str, Any]
    """Resolved settings of the estimator."""
    reference: str
    """Reference estimator that normalizes frame times."""
    rules: Rules
    design: Design
    platform: str
    generator: str
    """Digest of the sources that recorded the sequences."""
    software: Mapping[str, Any]
    """Versions, and the OpenGL driver."""
    sequences: tuple[Recorded, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _is_of_its_design(self) -> Self:
        if tuple((x.scene, x.seed) for x in self.sequences) != self.design.sequences:
            raise ValueError("sequences: are not those of design")
        return self

    @property
    def measured(self) -> list[Measurement]:
        """Measurement of each sequence."""
        return [x.measured for x in self.sequences]

    @property
    def scenes(self) -> list[str]:
        """Scene of each sequence."""
        return [x.scene for x in self.sequences]


def this_platform() -> str:
    """Return operating system and processor architecture."""
    return f"{platform.system()} {platform.machine()}"


def read_baseline(path: Path) -> Baseline:
    """Read what `write_baseline` wrote.

    Raises:
        DatasetError: If the file is missing, no baseline, or of another schema.
        SettingsError: If a value in it is not accepted.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DatasetError(
            f"{path}: cannot be read ({error.strerror}); `driftyard gate update` writes one"
        ) from None
    except ValueError:
        raise DatasetError(f"{path}: not a gate baseline") from None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise DatasetError(f"{path}: not a gate baseline")
    version = content.get("schema_version")
    if version != SCHEMA_VERSION:
        raise DatasetError(
            f"{path}: baseline of schema {version}, this program reads {SCHEMA_VERSION}; "
            "run `driftyard gate update`"
        )
    return validated(Baseline, content)


def write_baseline(path: Path, baseline: Baseline) -> None:
    """Write a baseline, completely or not at all."""
    write_text(path, baseline.model_dump_json(indent=1) + "\n")


def platform_mismatch(baseline: Baseline) -> str:
    """Describe how this platform differs from that of the baseline; empty if it does not."""
    here = this_platform()
    return "" if here == baseline.platform else f"platform is {here}, was {baseline.platform}"


def dataset_mismatch(
    baseline: Baseline, hashes: Sequence[str], generator: str, software: Mapping[str, Any]
) -> str:
    """Describe how the sequences differ from the baseline, with likely causes; empty if equal.

    Args:
        baseline: Baseline.
        hashes: Hashes of the contents of its sequences, recorded here.
        generator: Digest of the sources here.
        software: Versions and OpenGL driver here.
    """
    pairs = list(zip(baseline.sequences, hashes, strict=True))
    other = [known for known, sha256 in pairs if known.sha256 != sha256]
    if not other:
        return ""
    causes = [] if generator == baseline.generator else ["the generator's sources changed"]
    for name, now in software.items():
        was = baseline.software.get(name)
        if was != now:
            causes.append(f"{name} is {_version(now)}, was {_version(was)}")
    why = f" ({'; '.join(causes)})" if causes else ""
    return (
        f"datasets differ in {len(other)} of {len(pairs)} sequences, the first {other[0].scene} "
        f"seed {other[0].seed}{why}"
    )


def refuse(path: Path, kind: str, mismatch: str, accepted: Collection[str]) -> None:
    """Raise DatasetError for a mismatch of a kind that is not accepted."""
    if mismatch and kind not in accepted:
        raise DatasetError(f"{path}: {mismatch}; run `driftyard gate update`, or --accept {kind}")


def _version(version: Any) -> str:
    return version.get("renderer", "?") if isinstance(version, dict) else str(version)
