"""Verification: hashes and certificate of a dataset folder, recomputed from its files."""

import hashlib
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sim.camera.camera import FrameExposure
from sim.certificate.blur import CameraMotion
from sim.certificate.certificate import certify, check_folder, exempt_parts
from sim.certificate.frame_residual import FrameView, frame_residual
from sim.certificate.label_coverage import COVERAGE
from sim.certificate.manifest_check import check_digest, check_statements, differences
from sim.certificate.photometric import FrameResidual, PhotometricCheck
from sim.certificate.trajectory_check import read_states
from sim.dataset.tables import EXPOSURES
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.lens import margin_px
from sim.labels.formats import LABELS, label_file
from sim.labels.labels import disparity_from_depth
from sim.progress import Progress
from sim.sensors.inertial import T_body_imu
from sim.settings import RecordSettings, recorded_settings
from sim.world.rig import stereo_rig, widened
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.dataset import MANIFEST, TRUTH, read_manifest
from vo.contract.errors import DatasetError
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.recordings.euroc import open_euroc
from vo.recordings.images import read_codes, read_float
from vo.recordings.tables import read_columns

TOLERANCES = {
    "median_grey": 0.1,
    "rms_grey": 0.1,
    "p95_grey": 0.2,
    "beyond_noise_fraction": 0.01,
    "worst_frame_median_grey": 0.2,
    "noise_median_grey": 0.1,
    "visible_fraction": 1e-4,
    "bias_px": 0.01,
    "bias_error_px": 0.01,
    "smallest_bias_found_px": 0.05,
    "worst_frame_bias_px": 0.05,
    "smallest_frame_bias_found_px": 0.05,
    "smallest_worst_frame_bias_found_px": 1.0,
}
"""Tolerance of each figure for another OpenCV's interpolation and grey conversion."""
OTHERS = 1e-4
"""Tolerance, absolute and relative, of the other checks' figures."""
NOT_COMPARED = ("about", "worst_frame_ns", "worst_frame_bias_ns", "frames_without_texture")
"""Figures that another OpenCV may turn from one frame to another, and words."""


@dataclass(frozen=True)
class Finding:
    """A defect of a file, stated in one line; the path is inside the folder."""

    file: str
    problem: str


def verify(folder: Path, progress: Progress | None = None) -> list[Finding]:
    """Recompute every hash, the manifest's statements and the certificate; list the defects.

    The photometric parts of the certificate need depth or disparity labels.

    Raises:
        DatasetError: If the folder or its manifest is missing, or a file cannot be decoded.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder")
    manifest = read_manifest(folder)
    findings = [Finding(MANIFEST, problem) for problem in check_digest(manifest)]
    findings += _check_hashes(folder, manifest)
    if findings:  # pixels of damaged files are not checked
        return findings
    settings = recorded_settings(_table(folder, manifest, "settings"))
    statements = check_statements(folder, manifest, settings)
    findings += [Finding(MANIFEST, problem) for problem in statements]
    return findings + _check_certificate(folder, manifest, settings, progress)


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
    folder: Path, manifest: dict[str, Any], settings: RecordSettings, progress: Progress | None
) -> list[Finding]:
    stated: dict[str, Any] = _table(folder, manifest, "certificate")
    frames, contradictory = _measure(folder, settings, progress)
    gravity_mps2 = _gravity(folder, manifest)
    checks = check_folder(folder, settings, manifest.get("ended", ""), gravity_mps2)
    found = certify(frames, checks, exempt_parts(settings), settings.render.engine == "filament")
    parts = {key: figures for key, figures in found.items() if isinstance(figures, dict)}
    findings = [x for part, figures in parts.items() for x in _compare(part, stated, figures)]
    if contradictory:
        first = f"{len(contradictory)} frames, the first at {contradictory[0]} ns"
        findings.append(Finding("mav0", f"disparity and depth contradict each other in {first}"))
    # Without labels, the photometric part is not recomputed.
    rendered = {COVERAGE} & stated.keys()  # neither is what only the renderer can tell
    if any(stated[part].get("passed") is not True for part in rendered):
        findings.append(Finding("mav0", "images show what labels do not know of, or less"))
    needed = {*parts, "stereo", *rendered}
    passed = all(stated.get(part, {}).get("passed") is True for part in needed)
    if stated.get("passed") is not passed:
        findings.append(Finding(MANIFEST, f"certificate.passed is {stated.get('passed')!r}"))
    return findings


def _gravity(folder: Path, manifest: dict[str, Any]) -> Array:
    """Return the gravity (3,) that the manifest of a dataset states."""
    try:
        gravity_mps2 = np.array(manifest["physics"]["gravity_mps2"], dtype=float)
    except (KeyError, TypeError, ValueError):
        gravity_mps2 = np.empty(0)
    if gravity_mps2.shape != (3,) or not np.isfinite(gravity_mps2).all():
        raise DatasetError(f"{folder / MANIFEST}: physics.gravity_mps2 is not x, y, z in m/s^2")
    return gravity_mps2


def _compare(part: str, stated: dict[str, Any], found: dict[str, Any]) -> list[Finding]:
    """Return which figures of a part of the certificate changed, and whether it fails."""
    figures = stated.get(part, {})
    findings = [
        Finding(MANIFEST, problem)
        for key, value in found.items()
        for problem in differences(
            f"certificate.{part}.{key}", figures.get(key), value, _tolerance(key, value)
        )
        if key not in NOT_COMPARED
    ]
    if found["passed"]:
        return findings
    label = {"stereo": "disparity", "flow": "flow"}.get(part)
    failed: list[int] = found.get("failed_frames_ns", [])
    if label and failed:
        frames = f"{len(failed)} frames, the first at {failed[0]} ns"
        findings.append(Finding("mav0", f"the {label} does not explain {frames}"))
    if label and found["shifted"]:
        bias, error = found["bias_px"], found["bias_error_px"]
        problem = f"the {label} does not explain the images: its bias is {bias}, error {error} px"
        findings.append(Finding("mav0", problem))
    if not label:
        findings.append(Finding("mav0", f"the {part} check fails: {found}"))
    return findings


def _tolerance(key: str, value: Any) -> float:
    """Return the tolerance of a figure, relative to values above 1."""
    scale = max(1.0, abs(value)) if isinstance(value, float) else 1.0
    return TOLERANCES[key] / scale if key in TOLERANCES else OTHERS


def _measure(
    folder: Path, settings: RecordSettings, progress: Progress | None
) -> tuple[list[FrameResidual], list[int]]:
    """Compute the residuals of every frame; none without a disparity or depth label.

    Returns also the times at which disparity and depth labels contradict each other.
    """
    if not any((folder / "mav0" / LABELS[x].folder).is_dir() for x in ("disparity", "depth")):
        return [], []
    rig = stereo_rig(settings.rig)
    times_ns, T_world_body, _ = read_states(folder / TRUTH / "data.csv")
    T_world_cam = dict(zip(times_ns.tolist(), T_world_body @ rig.T_body_cam, strict=True))
    unit_ns, T_world_unit, _ = read_states(folder / "mav0/imu0/truth.csv")
    T_unit_cam = se3.inverse(T_body_imu(settings.imu)) @ rig.T_body_cam
    motion = CameraMotion(unit_ns, T_world_unit @ T_unit_cam, rig)
    render_rig = widened(rig, margin_px(settings, rig))
    sensors = [ImageSensor(settings, camera, rig, render_rig) for camera in (0, 1)]
    check = PhotometricCheck(settings, rig, sensors)
    exposures = _read_exposures(folder)
    sequence = open_euroc(folder)
    for table, rows in ((TRUTH, T_world_cam), (EXPOSURES, exposures)):
        absent = [t for t in sequence.timestamps_ns.tolist() if t not in rows]
        if absent:
            raise DatasetError(f"{folder / table}: has no row of the frame at {absent[0]} ns")

    def view(frame: StereoFrame) -> FrameView:
        time_ns = frame.timestamp_ns
        return FrameView(exposures[time_ns], frame.left, frame.right, T_world_cam[time_ns])

    frames: list[FrameResidual] = []
    contradictory: list[int] = []
    for frame, following in pairwise(chain(sequence, [None])):
        assert frame is not None
        labels, consistent = _read_labels(
            folder, settings, rig, frame.timestamp_ns, following is not None
        )
        if not consistent:
            contradictory.append(frame.timestamp_ns)
        views = view(frame), view(following) if following else None
        frames.append(frame_residual(check, motion, rig, labels, *views))
        if progress:
            progress(len(frames), len(sequence))
    return frames, contradictory


def _read_exposures(folder: Path) -> dict[int, FrameExposure]:
    """Return how each frame was exposed, by timestamp."""
    times, rows = read_columns(folder / EXPOSURES)
    return {
        time_ns: FrameExposure(time_ns, exposure_ms, gain, int(subframes), brightness)
        for time_ns, (exposure_ms, gain, subframes, brightness) in zip(
            times.tolist(), rows.tolist(), strict=True
        )
    }


def _read_labels(
    folder: Path, settings: RecordSettings, rig: StereoRig, time_ns: int, has_next: bool
) -> tuple[dict[str, Array], bool]:
    """Read the labels of a frame by name, and whether disparity and depth say the same.

    Either of the two is enough: the disparity follows from the depth.
    """
    files = {name: label_file(folder, name, time_ns) for name in ("disparity", "depth")}
    names = [name for name, file in files.items() if file.is_file()] or ["disparity"]
    labels, consistent = {name: read_float(files[name]) for name in names}, True
    if "depth" in labels:
        computed = disparity_from_depth(rig, labels["depth"])
        stated = labels.setdefault("disparity", computed)
        consistent = np.allclose(stated, computed, 1e-5, 1e-5, equal_nan=True)
    if settings.labels.flow and has_next:
        labels["flow"] = read_float(label_file(folder, "flow", time_ns), 3)
        if settings.labels.covisibility:
            labels["covisibility"] = read_codes(label_file(folder, "covisibility", time_ns))
    return labels, consistent


def _table(folder: Path, manifest: dict[str, Any], key: str) -> dict[str, Any]:
    if not isinstance(manifest.get(key), dict):
        raise DatasetError(f"{folder / MANIFEST}: {key} is missing or not a table")
    return manifest[key]
