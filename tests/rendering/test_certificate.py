"""Each check of the certificate fails where what it checks is wrong, though all hashes fit.

One recording under noise is tampered with as a careful forger would: hashes and digest fit again.
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from forgery import hash_again

from sim.certificate.bias import Shift
from sim.certificate.certificate import certify, check_folder, detectable_shifts
from sim.certificate.manifest_check import check_digest, check_statements
from sim.certificate.photometric import FrameResidual, Residual
from sim.certificate.verify import verify
from sim.dataset.image_codecs import encode_float
from sim.record import record
from sim.sensors.inertial import EARTH_GRAVITY_MPS2
from sim.settings import (
    DriveSettings,
    LabelSettings,
    RecordSettings,
    RenderSettings,
    RigSettings,
    SensorSettings,
    recorded_settings,
)
from vo.contract.dataset import DIGEST, MANIFEST, read_manifest
from vo.recordings.images import read_float

pytestmark = pytest.mark.gl

SETTINGS = RecordSettings(
    rig=RigSettings(width_px=320, height_px=240, rate_hz=10),
    drive=DriveSettings(distance_m=0.3),
    render=RenderSettings(samples=0, shadow_size_px=256),
    sensor=SensorSettings(full_well=500, read_noise=15),
    labels=LabelSettings(flow=True, covisibility=True),
)
"""The noise is that of the disturbance of this name at strength 1."""
EARTH = np.array(EARTH_GRAVITY_MPS2)
BODY = "mav0/state_groundtruth_estimate0/data.csv"
UNIT = "mav0/imu0/truth.csv"
READINGS = "mav0/imu0/data.csv"
WHEELS = "mav0/wheels0/data.csv"


@pytest.fixture(scope="module")
def dataset(make_scene, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("certificate") / "noisy"
    record(make_scene(boxes=True), SETTINGS, out)
    return out


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(dataset, tmp_path / "copy"))


def forge(folder: Path, change: Callable[[dict[str, Any]], None] = lambda _: None) -> list[str]:
    """Change the manifest, make all hashes fit, and return what `verify` finds."""
    hash_again(folder, change)
    return [f"{finding.file}: {finding.problem}" for finding in verify(folder)]


def shift(folder: Path, label: str, by_px: tuple[float, ...], frames: slice = slice(None)) -> None:
    """Add to the channels of a label, in all frames or in some."""
    for path in sorted((folder / f"mav0/{label}0/data").iterdir())[frames]:
        values = read_float(path, 3 if label == "flow" else 1).copy()
        if len(by_px) > 1:
            values[..., : len(by_px)] += np.array(by_px, np.float32)
        else:
            values += np.float32(by_px[0])
        path.write_bytes(encode_float(np.ascontiguousarray(values)))


def edit(table: Path, row: int, column: int, change: Callable[[float], float]) -> None:
    """Change one number of a table; rows count from 0 after the header."""
    lines = table.read_text().splitlines()
    words = lines[1 + row].split(",")
    words[column] = repr(change(float(words[column])))
    lines[1 + row] = ",".join(words)
    table.write_text("\n".join(lines) + "\n")


def test_forged_copy_without_change_verifies(copy):
    assert forge(copy) == []


def test_certificate_states_the_smallest_shift_that_is_found(dataset):
    certificate = read_manifest(dataset)["certificate"]
    for part in ("stereo", "flow"):
        figures = certificate[part]
        assert np.abs(figures["bias_px"]).max() < 0.03
        assert 0 < max(figures["bias_error_px"]) < 0.02
        assert figures["smallest_bias_found_px"] < 0.15
        assert figures["smallest_worst_frame_bias_found_px"] < 1
    lines = detectable_shifts(certificate)
    assert [line.split(":")[0] for line in lines] == ["disparity", "flow"]
    assert all("the smallest shift that is found is 0.1" in line for line in lines)


@pytest.mark.parametrize(
    ("label", "by_px"), [("disparity", (0.15,)), ("disparity", (-3.0,)), ("flow", (0.15, -0.15))]
)
def test_shift_of_all_frames_is_found(copy, label, by_px):
    """Also by more than the grain of the texture, where gradients have nothing in common."""
    shift(copy, label, by_px)
    start = f"mav0: the {label} does not explain the images: its bias is "
    found = next(x for x in forge(copy) if x.startswith(start))
    if abs(by_px[0]) < 1:
        bias = json.loads(found.removeprefix(start).split(", error")[0])
        np.testing.assert_allclose(bias, by_px, atol=0.05)


@pytest.mark.parametrize("by_px", [0.9, -0.9, 8.0])
def test_shift_of_one_frame_is_found(copy, by_px):
    shift(copy, "disparity", (by_px,), slice(4, 5))
    shift(copy, "flow", (0.0, by_px), slice(6, 7))
    times = [path.stem for path in sorted((copy / "mav0/cam0/data").iterdir())]
    problems = forge(copy)
    for label, time_ns in (("disparity", times[4]), ("flow", times[6])):
        problem = f"mav0: the {label} does not explain 1 frames, the first at {time_ns} ns"
        assert problem in problems


def test_labels_that_contradict_each_other_are_found(copy):
    shift(copy, "depth", (0.01,), slice(2, 3))
    shift(copy, "flow", (0.02, 0.0), slice(3, 4))
    problems = forge(copy)
    assert any("disparity and depth contradict each other in 1 frames" in x for x in problems)
    assert any("the geometry check fails" in x for x in problems)


def test_certificate_passes_only_if_each_of_its_parts_does():
    zero = np.zeros((1, 1)), np.zeros(1), np.zeros((1, 1)), np.zeros(1), np.zeros(1)
    right, wrong = (
        FrameResidual(
            k, Residual(np.eye(1, 2000, 1999 * k)[0].astype(int), 1.0, 1.0, 1.0, Shift(*zero)), None
        )
        for k in (0, 1)
    )
    checks = {"inertial": {"passed": True}}
    assert certify([right], checks)["passed"]
    assert not certify([right, wrong], checks)["passed"]
    assert certify([right, wrong], checks, frozenset({"stereo"}))["passed"]
    assert not certify([right], {"inertial": {"passed": False}})["passed"]


def failing(folder: Path) -> list[str]:
    return [
        name for name, x in check_folder(folder, SETTINGS, "", EARTH).items() if not x["passed"]
    ]


@pytest.mark.parametrize(
    ("table", "column", "by"),
    [
        (BODY, 1, 0.001),
        (BODY, 6, 0.001),
        (BODY, 9, 0.02),
        (BODY, 12, 1e-3),
        (UNIT, 2, 0.001),
        (UNIT, 7, 0.001),
        (UNIT, 10, 0.02),
    ],
)
def test_every_row_of_the_true_states_is_checked(copy, table, column, by):
    text = (copy / table).read_text()
    for row in (0, len(text.splitlines()) // 2, len(text.splitlines()) - 2):
        edit(copy / table, row, column, lambda x: x + by)
        assert set(failing(copy)) & {"trajectory", "inertial"}, row
        (copy / table).write_text(text)
    assert failing(copy) == []


def test_state_before_those_of_the_inertial_unit_is_found(copy):
    first_ns = int((copy / UNIT).read_text().splitlines()[1].split(",")[0])
    header, row, *rows = (copy / BODY).read_text().splitlines()
    earlier = ",".join([str(first_ns - 5_000_000), *row.split(",")[1:]])
    (copy / BODY).write_text("\n".join([header, earlier, *rows]) + "\n")
    assert failing(copy) == ["trajectory"]


def test_inertial_reading_that_explains_no_motion_is_found(copy):
    edit(copy / READINGS, 77, 4, lambda x: x + 0.5)
    assert failing(copy) == ["inertial"]


def test_gyroscope_bias_below_the_noise_is_found_by_the_turn(copy):
    header, *lines = (copy / READINGS).read_text().splitlines()
    rows = [line.split(",") for line in lines]
    biased = [",".join([*x[:2], repr(float(x[2]) + 0.005), *x[3:]]) for x in rows]
    (copy / READINGS).write_text("\n".join([header, *biased]) + "\n")
    found = check_folder(copy, SETTINGS, "", EARTH)["inertial"]
    assert not found["failed_readings_ns"]
    assert not found["passed"]


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.3), (0.0, 0.0, -1.62), (0.5, 0.0, -9.81)])
def test_readings_under_another_gravity_are_found(copy, gravity):
    checks = check_folder(copy, SETTINGS, "", np.array(gravity))
    assert not checks["inertial"]["passed"]


def test_wheels_that_turn_too_far_are_found(copy):
    header, *lines = (copy / WHEELS).read_text().splitlines()
    rows = [[int(word) for word in line.split(",")] for line in lines]
    farther = [f"{time_ns},{left * 21 // 20},{right * 21 // 20}" for time_ns, left, right in rows]
    (copy / WHEELS).write_text("\n".join([header, *farther]) + "\n")
    assert failing(copy) == ["encoders"]


def set_at(*keys: str, value: Any = None, by: float = 0.0) -> Callable[[dict[str, Any]], None]:
    """Return an edit of one value of the manifest: a new one, or the old one changed."""

    def change(manifest: dict[str, Any]) -> None:
        table = manifest
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = table[keys[-1]] + by if value is None else value

    return change


EDITS = {
    "seed": set_at("seed", by=1),
    "rig": set_at("rig", "baseline_m", by=0.001),
    "true rig": set_at("rig_true", "f_px", by=1.0),
    "path length": set_at("path_length_m", by=0.01),
    "frames": set_at("frames", by=1),
    "dropped frames": set_at("dropped_frames", by=1),
    "complete": set_at("complete", value=False),
    "settings": set_at("settings", "rig", "baseline_m", by=0.001),
    "calibration": set_at("settings", "calibration", "focal_percent", value=1.0),
}


@pytest.mark.parametrize("name", EDITS)
def test_edited_statement_of_the_manifest_is_found(dataset, name):
    """By the digest, and by settings and tables if the digest was computed anew."""
    manifest = read_manifest(dataset)
    EDITS[name](manifest)
    assert list(check_digest(manifest)) == [f"differs from its own digest, {DIGEST}"]
    settings = recorded_settings(manifest["settings"])
    assert list(check_statements(dataset, manifest, settings))


def test_calibration_other_than_the_stated_rig_is_found(copy):
    f_px = read_manifest(copy)["rig"]["f_px"]
    for camera in (0, 1):
        path = copy / f"mav0/cam{camera}/sensor.yaml"
        path.write_text(path.read_text().replace(f"- {f_px}\n", "- 250.0\n"))
    problems = list(check_statements(copy, read_manifest(copy), SETTINGS))
    assert any(x.startswith("rig.f_px") and "from cam0/sensor.yaml" in x for x in problems)


def test_inertial_reading_that_is_missing_is_found(copy):
    lines = (copy / READINGS).read_text().splitlines()
    (copy / READINGS).write_text("\n".join(lines[:-1]) + "\n")
    problems = list(check_statements(copy, read_manifest(copy), SETTINGS))
    assert problems == [f"imu0 has {len(lines) - 2} readings between {len(lines)} states"]


def test_edited_seeds_are_found_by_the_biases_of_the_unit(dataset):
    manifest = read_manifest(dataset)
    manifest["seed"] = 5
    settings = SETTINGS.model_copy(update={"seed": 5})
    problems = list(check_statements(dataset, manifest, settings))
    assert problems == ["seed is 5, by which the inertial unit has other biases"]


@pytest.mark.parametrize(
    "change",
    [
        set_at("certificate", "stereo", "noise_median_grey", by=1.0),
        set_at("certificate", "passed", value=False),
        set_at("certificate", "stereo", "smallest_bias_found_px", by=-0.06),
    ],
)
def test_edited_figure_of_the_certificate_is_found(copy, change):
    problems = forge(copy, change)
    assert len(problems) == 1
    assert problems[0].startswith(f"{MANIFEST}: certificate.")


def test_coverage_that_failed_at_recording_is_found(copy):
    problems = forge(copy, set_at("certificate", "coverage", "passed", value=False))
    assert "mav0: images show what labels do not know of, or less" in problems


def test_edited_or_missing_digest_is_found(copy):
    manifest = read_manifest(copy)
    manifest["scene"]["name"] = "another"
    (copy / MANIFEST).write_text(json.dumps(manifest))
    assert [x.problem for x in verify(copy)] == [f"differs from its own digest, {DIGEST}"]
    del manifest[DIGEST]
    (copy / MANIFEST).write_text(json.dumps(manifest))
    assert f"{DIGEST} is missing" in verify(copy)[0].problem
