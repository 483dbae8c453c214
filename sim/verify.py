"""Verification: a dataset folder's hashes and certificate, computed again from its files."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.certificate import FrameResidual, certify, measure_frame
from sim.labels import disparity_from_depth
from sim.record import Progress
from vo.contract.arrays import Array
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DatasetError
from vo.contract.euroc import open_euroc
from vo.contract.files import read_float
from vo.contract.rig import StereoRig

TOLERANCES = {
    "median_grey": 0.1,
    "rms_grey": 0.1,
    "p95_grey": 0.2,
    "worst_frame_median_grey": 0.2,
    "visible_fraction": 1e-4,
}
"""Room for another OpenCV's interpolation and grey conversion."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a dataset.

    Attributes:
        file: Path inside the folder.
        problem: One line.
    """

    file: str
    problem: str


def verify(folder: Path, progress: Progress | None = None) -> list[Finding]:
    """Recompute every hash and, if it has depth or disparity labels, the certificate.

    Returns:
        What is wrong; empty for a sound dataset.

    Raises:
        DatasetError: If the folder or its manifest is missing, or a file cannot be decoded.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder")
    manifest = read_manifest(folder)
    findings = _check_hashes(folder, manifest)
    if findings:  # damaged files need no second opinion from their pixels
        return findings
    return _check_certificate(folder, manifest, progress)


def _check_hashes(folder: Path, manifest: dict[str, Any]) -> list[Finding]:
    findings: list[Finding] = []
    listed: dict[str, str] = _table(folder, manifest, "sha256")
    for name, sha256 in listed.items():
        path = folder / name
        if not path.is_file():
            findings.append(Finding(name, "is missing"))
        elif hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
            findings.append(Finding(name, "differs from its hash"))
    present = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    findings += [Finding(name, "is not listed") for name in sorted(present - {MANIFEST, *listed})]
    return findings


def _check_certificate(
    folder: Path, manifest: dict[str, Any], progress: Progress | None
) -> list[Finding]:
    stated: dict[str, Any] = _table(folder, manifest, "certificate")
    sequence = open_euroc(folder)
    load = _disparity_loader(folder, sequence.rig)
    if load is None:
        return []
    residuals: list[FrameResidual] = []
    for frame in sequence:
        disparity_px = load(frame.timestamp_ns)
        residuals.append(measure_frame(frame.timestamp_ns, frame.left, frame.right, disparity_px))
        if progress:
            progress(len(residuals), len(sequence))
    found = certify(residuals)
    findings = [
        Finding(MANIFEST, f"certificate.{key} is {stated.get(key)!r}, recomputed {found[key]!r}")
        for key, tolerance in TOLERANCES.items()
        if not abs(stated.get(key, float("inf")) - found[key]) <= tolerance
    ]
    failed: list[int] = found["failed_frames_ns"]
    if failed:
        problem = (
            f"the disparity does not explain {len(failed)} frames, the first at {failed[0]} ns"
        )
        findings.append(Finding("mav0", problem))
    return findings


def _disparity_loader(folder: Path, rig: StereoRig) -> Callable[[int], Array] | None:
    """Map a time to the (H, W) disparity label, from depth if need be; None without labels."""
    disparity, depth = (folder / f"mav0/{label}0/data" for label in ("disparity", "depth"))
    if disparity.is_dir():
        return lambda time_ns: read_float(disparity / f"{time_ns}.tiff")
    if depth.is_dir():
        return lambda time_ns: disparity_from_depth(rig, read_float(depth / f"{time_ns}.tiff"))
    return None


def _table(folder: Path, manifest: dict[str, Any], key: str) -> dict[str, Any]:
    if not isinstance(manifest.get(key), dict):
        raise DatasetError(f"{folder / MANIFEST}: {key} is missing or not a table")
    return manifest[key]
