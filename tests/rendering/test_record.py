"""Dataset folders: complete, repeatable to the byte, verifiable, and whole or absent."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from forgery import hash_again

from sim.certificate.verify import Finding, verify
from sim.dataset.image_codecs import encode_png
from sim.record import record
from sim.settings import (
    DriveSettings,
    LabelSettings,
    RecordSettings,
    RenderSettings,
    RigSettings,
    recorded_settings,
)
from sim.world.world import START_S
from vo.contract.dataset import read_manifest
from vo.contract.errors import DatasetError
from vo.contract.settings import amended, with_defaults
from vo.recordings.images import read_float, read_grey
from vo.recordings.readers import open_sequence, read_truth

pytestmark = pytest.mark.gl

START_NS = round(START_S * 1e9)

SHORT = RecordSettings(
    rig=RigSettings(width_px=160, height_px=120, rate_hz=10),
    drive=DriveSettings(distance_m=0.25),
    render=RenderSettings(samples=0, shadow_size_px=256),
)


@pytest.fixture(scope="module")
def dataset(make_scene, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("record") / "first"
    record(make_scene(boxes=True), SHORT, out)
    return out


def test_record_applies_defaults_of_the_scene(make_scene, tmp_path):
    """They apply as on the command line; what was set in Python takes precedence."""
    defaults = {"rig.tilt_deg": 12.0, "drive.distance_m": 9.0, "exposure.time_ms": 7.0}
    settings = amended(SHORT, {"exposure.time_ms": 8.0, "labels.disparity": False})
    record(replace(make_scene(), defaults=defaults), settings, tmp_path / "d")
    made = read_manifest(tmp_path / "d")["settings"]
    assert made["rig"]["tilt_deg"] == 12.0
    assert made["rig"]["width_px"] == SHORT.rig.width_px
    assert made["drive"]["distance_m"] == SHORT.drive.distance_m
    assert made["exposure"]["time_ms"] == 8.0
    assert with_defaults(recorded_settings(made), {"rig.tilt_deg": 3.0}).rig.tilt_deg == 12.0


@pytest.fixture
def damaged(dataset, tmp_path) -> Path:
    """A copy to spoil."""
    copy = tmp_path / "copy"
    for path in dataset.rglob("*"):
        if path.is_file():
            target = copy / path.relative_to(dataset)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    return copy


def test_recording_opens_with_rig_and_ground_truth(dataset):
    sequence = open_sequence(dataset)
    stated = read_manifest(dataset)["rig"]
    assert len(sequence) == read_manifest(dataset)["frames"] > 10
    assert sequence.timestamps_ns[0] == START_NS
    np.testing.assert_array_equal(np.diff(sequence.timestamps_ns), 100_000_000)
    for key in ("f_px", "cx_px", "cy_px", "baseline_m"):
        assert getattr(sequence.rig, key) == pytest.approx(stated[key], abs=1e-12)
    np.testing.assert_allclose(sequence.rig.T_body_cam, stated["T_body_cam"], atol=1e-12)
    truth = read_truth(dataset)
    assert truth is not None
    moved = truth.T_ref_frame[-1, :3, 3] - truth.T_ref_frame[0, :3, 3]
    np.testing.assert_allclose(moved, [0.25, 0, 0], atol=0.015)
    left = sequence[0].left
    np.testing.assert_array_equal(left, read_grey(dataset / f"mav0/cam0/data/{START_NS}.png"))


def test_depth_and_disparity_labels_agree(dataset):
    rig = open_sequence(dataset).rig
    depth_m = read_float(dataset / f"mav0/depth0/data/{START_NS}.tiff")
    disparity_px = read_float(dataset / f"mav0/disparity0/data/{START_NS}.tiff")
    sky = np.isnan(depth_m)
    assert sky.any()
    np.testing.assert_array_equal(sky, np.isnan(disparity_px))
    product = depth_m[~sky] * disparity_px[~sky]
    np.testing.assert_allclose(product, rig.f_px * rig.baseline_m, rtol=1e-6)
    assert np.nanmin(depth_m) > 0.3


def test_recording_certifies_itself(dataset):
    certificate = read_manifest(dataset)["certificate"]
    assert certificate["passed"]
    stereo = certificate["stereo"]
    assert 0 < stereo["median_grey"] < stereo["p95_grey"]
    assert 0.5 < stereo["visible_fraction"] < 1
    assert verify(dataset) == []


def test_recording_repeats_with_its_seed(dataset, make_scene, tmp_path):
    record(make_scene(boxes=True), SHORT, tmp_path / "second")
    assert _content(tmp_path / "second") == _content(dataset)


def test_labels_switched_off_are_absent(make_scene, tmp_path):
    depth_only = SHORT.model_copy(update={"labels": LabelSettings(disparity=False)})
    record(make_scene(), depth_only, tmp_path / "depth")
    assert not (tmp_path / "depth/mav0/disparity0").exists()
    assert verify(tmp_path / "depth") == []


def test_color_images_are_recorded(make_scene, tmp_path):
    rig = SHORT.rig.model_copy(update={"color": True})
    record(make_scene(boxes=True), SHORT.model_copy(update={"rig": rig}), tmp_path / "color")
    path = tmp_path / f"color/mav0/cam0/data/{START_NS}.png"
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image.shape == (120, 160, 3)
    red = (image[..., 2] > 2 * image[..., 1]) & (image[..., 2] > 2 * image[..., 0])
    assert red.any()  # the boxes are red, not blue
    assert verify(tmp_path / "color") == []


def test_verify_names_damaged_missing_and_extra_files(damaged):
    image = f"mav0/cam0/data/{START_NS}.png"
    (damaged / image).write_bytes(b"nonsense")
    (damaged / "mav0/wheels0/data.csv").unlink()
    (damaged / "notes.txt").write_text("mine")
    assert verify(damaged) == [
        Finding(image, "differs from its hash"),
        Finding("mav0/wheels0/data.csv", "is missing"),
        Finding("notes.txt", "is not listed"),
    ]


def test_verify_finds_images_that_contradict_labels(damaged):
    """Swapped images with correct hashes: only the certificate can tell."""
    for left in sorted((damaged / "mav0/cam0/data").iterdir()):
        right = damaged / "mav0/cam1/data" / left.name
        images = read_grey(left), read_grey(right)
        left.write_bytes(encode_png(images[1]))
        right.write_bytes(encode_png(images[0]))
    hash_again(damaged)
    problems = [finding.problem for finding in verify(damaged)]
    assert any(problem.startswith("the disparity does not explain") for problem in problems)
    assert any(problem.startswith("certificate.stereo.median_grey is") for problem in problems)


def test_verify_folder_without_manifest_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="no such folder"):
        verify(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match=r"dataset\.json"):
        verify(tmp_path)


def test_interrupted_recording_leaves_no_files(make_scene, tmp_path):
    def interrupt(done: int, total: int) -> None:
        assert 0 < done <= total
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(make_scene(), SHORT, tmp_path / "cut", progress=interrupt)
    assert list(tmp_path.iterdir()) == []


def test_existing_folder_is_not_overwritten(dataset, make_scene):
    before = _content(dataset)
    with pytest.raises(DatasetError, match="already exists"):
        record(make_scene(), SHORT, dataset)
    assert _content(dataset) == before


def _content(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
