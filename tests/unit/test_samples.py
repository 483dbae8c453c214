"""Training samples as arrays, without PyTorch."""

import json
import pickle
import sys
from importlib import import_module

import cv2
import numpy as np
import pytest

import driftyard as dy
from driftyard.samples import samples_of
from trials.formats.tartanair import encode_depth, encode_flow
from vo.contract.errors import DatasetError, FrameIndexError, SettingsError

SIZE, FRAMES = (64, 48), 4
DEPTH = np.full(SIZE[::-1], 2.0, np.float32)
DEPTH[0] = np.nan
CAMERA = {"fx": 50, "fy": 50, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48, "baseline": 0.1}


def write_folder(folder, frames=FRAMES, level=0):
    """A folder of TartanAir: the camera moves by 0.1 m to the right a frame."""
    for side in ("l", "r"):
        eye = folder / f"image_{side}cam_front"
        eye.mkdir(parents=True)
        for i in range(frames):
            image = np.full(SIZE[::-1], level + 10 * i + (side == "r"), np.uint8)
            cv2.imwrite(str(eye / f"{i:06d}_{side}cam_front.png"), image)
    for name in ("imu", "depth_lcam_front", "flow_lcam_front"):
        (folder / name).mkdir()
    flow = np.dstack([np.full_like(DEPTH, -2.5), np.zeros_like(DEPTH)])
    flow[:, 5] = np.nan
    for i in range(frames):
        (folder / f"depth_lcam_front/{i:06d}_depth.png").write_bytes(encode_depth(DEPTH))
        (folder / f"flow_lcam_front/{i:06d}_flow.png").write_bytes(encode_flow(flow, None))
    poses = [[0, 0.1 * i, 0, 0, 0, 0, 1] for i in range(frames)]
    np.savetxt(folder / "pose_lcam_front.txt", poses)
    (folder / "imu/cam_time.txt").write_text("".join(f"{0.1 * i:.1f}\n" for i in range(frames)))
    (folder / "camera.json").write_text(json.dumps(CAMERA))
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("samples") / "a")


def test_sample_holds_images_labels_and_calibration(folder):
    samples = samples_of(folder)
    assert len(samples) == FRAMES
    sample = samples[2]
    assert set(sample) == {
        *("left", "right", "disparity", "disparity_valid", "K", "baseline_m", "timestamp_ns"),
    }
    assert sample["left"].shape == (1, 48, 64)
    assert sample["left"].dtype == np.float32
    assert sample["right"][0, 0, 0] == np.float32(21) / 255
    assert not sample["disparity_valid"][0, 0].any()
    assert sample["disparity_valid"][0, 1:].all()
    assert (sample["disparity"][0, 1:] == 50 * 0.1 / 2).all()
    assert (sample["disparity"][0, 0] == 0).all()
    assert sample["K"].tolist() == [[50, 0, 31.5], [0, 50, 23.5], [0, 0, 1]]
    assert sample["timestamp_ns"] == 200_000_000


def test_pairs_end_before_the_last_frame_of_each_recording(folder, tmp_path):
    other = write_folder(tmp_path / "b", frames=3, level=100)
    items = ("left", "left_next", "flow", "T_cam_next", "covisibility", "sequence")
    samples = samples_of([folder, dy.open(other)], items, channels=3, as_float=False)
    assert len(samples) == FRAMES - 1 + 2
    found = [(int(x["sequence"]), x["left"][0, 0, 0], x["left_next"][2, 9, 9]) for x in samples]
    assert found == [(0, 0, 10), (0, 10, 20), (0, 20, 30), (1, 100, 110), (1, 110, 120)]
    sample = samples[-1]
    assert sample["left"].shape == (3, 48, 64)
    assert sample["left"].dtype == np.uint8
    assert sample["flow"].shape == (2, 48, 64)
    assert not sample["flow_valid"][0, :, 5].any()
    assert (sample["flow"][0][sample["flow_valid"][0]] == -2.5).all()
    assert np.allclose(sample["T_cam_next"][:3, 3], [0.1, 0, 0], atol=1e-6)
    assert sample["covisibility"].dtype == np.int64


def test_chosen_frames_and_pickles_keep_their_samples(folder):
    samples = samples_of(dy.open(folder, first=1, every=2), ("left", "left_next", "T_cam_next"))
    assert len(samples) == 1
    again = pickle.loads(pickle.dumps(samples))
    assert np.array_equal(again[0]["left_next"], samples[0]["left_next"])
    assert np.allclose(again[0]["T_cam_next"][:3, 3], [0.2, 0, 0], atol=1e-6)


def test_unusable_choices_are_named(folder, tmp_path):
    with pytest.raises(SettingsError, match="item dispartiy: expected left, right, left_next"):
        samples_of(folder, ("left", "dispartiy"))
    with pytest.raises(SettingsError, match="channels 4: expected 1 or 3"):
        samples_of(folder, channels=4)
    with pytest.raises(SettingsError, match="expected at least one"):
        samples_of([])
    with pytest.raises(DatasetError, match="a: has no normals labels; it has depth, disparity, fl"):
        samples_of(folder, ("left", "normals"))
    with pytest.raises(SettingsError, match="flow is to the next frame; open it with every=1"):
        samples_of(dy.open(folder, every=2), ("flow",))
    with pytest.raises(DatasetError, match="no frame that is followed by another"):
        samples_of(dy.open(folder, last=0), ("left_next",))
    with pytest.raises(FrameIndexError, match="sample 4: there are 4"):
        samples_of(folder)[4]
    (tmp_path / "c").mkdir()
    with pytest.raises(DatasetError, match="not a recording"):
        samples_of([folder, tmp_path / "c"])


def test_missing_torch_names_the_extra(folder, monkeypatch):
    monkeypatch.delitem(sys.modules, "driftyard.torch", raising=False)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(dy.DriftyardError, match=r"pip install 'driftyard\[torch\]'"):
        import_module("driftyard.torch").StereoDataset(folder)
    with pytest.raises(dy.DriftyardError, match=r"pip install 'driftyard\[torch\]'"):
        dy.open(folder).to_torch()
