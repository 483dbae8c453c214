"""Verification: hashes and certificate of a dataset folder, recomputed from its files."""

import hashlib
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

from sim.camera.camera import FrameExposure
from sim.certificate.certificate import certify, check_folder, exempt_parts
from sim.certificate.photometric import FrameResidual, PhotometricCheck
from sim.dataset.tables import EXPOSURES
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.lens import margin_px
from sim.labels.formats import LABELS, label_file
from sim.labels.labels import disparity_from_depth
from sim.progress import Progress
from sim.settings import RecordSettings, recorded_settings
from sim.world.rig import stereo_rig, widened
from vo.contract.arrays import Array
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DatasetError
from vo.contract.euroc import open_euroc
from vo.contract.images import read_codes, read_float
from vo.contract.rig import StereoRig
from vo.contract.tables import read_columns

TOLERANCES = {
    "median_grey": 0.1,
    "rms_grey": 0.1,
    "p95_grey": 0.2,
    "worst_frame_median_grey": 0.2,
    "noise_median_grey": 0.1,
    "visible_fraction": 1e-4,
}
"""Tolerance of each figure for another OpenCV's interpolation and grey conversion."""
OTHERS = 1e-4
"""Tolerance, absolute and relative, of the other checks' figures."""


@dataclass(frozen=True)
class Finding:
    """A defect of a file, stated in one line; the path is inside the folder."""

    file: str
    problem: str


def verify(folder: Path, progress: Progress | None = None) -> list[Finding]:
    """Recompute every hash and, with depth or disparity labels, the certificate; list the defects.

    Raises:
        DatasetError: If the folder or its manifest is missing, or a file cannot be decoded.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder")
    manifest = read_manifest(folder)
    findings = _check_hashes(folder, manifest)
    if findings:  # pixels of damaged files are not checked
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
    settings = recorded_settings(_table(folder, manifest, "settings"))
    frames = _measure(folder, settings, progress)
    if not frames:
        return []
    checks = check_folder(folder, settings, manifest.get("ended", ""))
    found = certify(frames, checks, exempt_parts(settings))
    parts = ((part, figures) for part, figures in found.items() if isinstance(figures, dict))
    return [x for part, figures in parts for x in _compare(part, stated.get(part, {}), figures)]


def _compare(part: str, stated: dict[str, Any], found: dict[str, Any]) -> list[Finding]:
    """Return which figures of a part of the certificate changed, and whether it fails."""
    findings: list[Finding] = []
    for key, value in found.items():
        if isinstance(value, float):
            room = TOLERANCES.get(key, OTHERS * max(1.0, abs(value)))
            if not abs(stated.get(key, float("inf")) - value) <= room:
                problem = f"certificate.{part}.{key} is {stated.get(key)!r}, recomputed {value!r}"
                findings.append(Finding(MANIFEST, problem))
    failed: list[int] = found.get("failed_frames_ns", [])
    if failed:
        label = {"stereo": "disparity", "flow": "flow"}[part]
        frames = f"{len(failed)} frames, the first at {failed[0]} ns"
        findings.append(Finding("mav0", f"the {label} does not explain {frames}"))
    elif not found["passed"]:
        findings.append(Finding("mav0", f"the {part} check fails: {found}"))
    return findings


def _measure(
    folder: Path, settings: RecordSettings, progress: Progress | None
) -> list[FrameResidual]:
    """Compute the residuals of every frame; none without a disparity or depth label."""
    if not any((folder / "mav0" / LABELS[x].folder).is_dir() for x in ("disparity", "depth")):
        return []
    rig = stereo_rig(settings.rig)
    render_rig = widened(rig, margin_px(settings, rig))
    sensors = [ImageSensor(settings, camera, rig, render_rig) for camera in (0, 1)]
    check = PhotometricCheck(settings, rig, sensors)
    exposures = _read_exposures(folder)
    sequence = open_euroc(folder)
    has_flow = settings.labels.flow and settings.labels.covisibility
    frames: list[FrameResidual] = []
    for frame, following in pairwise(chain(sequence, [None])):
        assert frame is not None
        time_ns = frame.timestamp_ns
        disparity = _read_disparity(folder, rig, time_ns)
        stereo = check.stereo(frame.left, frame.right, disparity, exposures[time_ns])
        flow = None
        if has_flow and following:
            label = read_float(label_file(folder, "flow", time_ns), 3)
            covisibility = read_codes(label_file(folder, "covisibility", time_ns))
            pair = exposures[time_ns], exposures[following.timestamp_ns]
            flow = check.flow(frame.left, following.left, label, covisibility, pair)
        frames.append(FrameResidual(time_ns, stereo, flow))
        if progress:
            progress(len(frames), len(sequence))
    return frames


def _read_exposures(folder: Path) -> dict[int, FrameExposure]:
    """Return how each frame was exposed, by timestamp."""
    times, rows = read_columns(folder / EXPOSURES)
    return {
        time_ns: FrameExposure(time_ns, exposure_ms, gain, int(subframes), brightness)
        for time_ns, (exposure_ms, gain, subframes, brightness) in zip(
            times.tolist(), rows.tolist(), strict=True
        )
    }


def _read_disparity(folder: Path, rig: StereoRig, time_ns: int) -> Array:
    """Read the (H, W) disparity label at a time, or compute it from the depth label."""
    label = label_file(folder, "disparity", time_ns)
    if label.is_file():
        return read_float(label)
    return disparity_from_depth(rig, read_float(label_file(folder, "depth", time_ns)))


def _table(folder: Path, manifest: dict[str, Any], key: str) -> dict[str, Any]:
    if not isinstance(manifest.get(key), dict):
        raise DatasetError(f"{folder / MANIFEST}: {key} is missing or not a table")
    return manifest[key]
