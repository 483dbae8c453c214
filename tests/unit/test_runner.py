"""From sequence to files and back."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from folders import PERIOD_NS, wall, write_euroc

from trials.estimators.choice import Named, estimate
from trials.evaluation.runs import read_run
from vo.contract.errors import DatasetError, ImageError, TrajectoryError
from vo.contract.estimator import Estimate, FinalResult, Observations, PointMap, Status
from vo.contract.files import replacing
from vo.contract.remarks import Remark
from vo.contract.trajectory import Trajectory
from vo.recordings.readers import open_sequence
from vo.recordings.trajectory_files import read_trajectory
from vo.runner import Run, UnfinishedRun, companion, run, write_run


class Scripted:
    """An estimator that starts, tracks, gets lost and resumes; stages differ by frame."""

    def __init__(self):
        self.frames = 0

    def track(self, frame):
        i, self.frames = self.frames, self.frames + 1
        T = np.eye(4)
        T[0, 3] = i
        if i == 0:
            return Estimate(frame.timestamp_ns, Status.START, T, counts={"corners": 9})
        if i == 2:
            return Estimate(frame.timestamp_ns, Status.LOST, None, 'dark, and "odd"')
        seen = Observations(
            np.array([7, 9]),
            np.array([[1.5, 2.5], [3, 4]]),
            np.array([8, np.nan]),
            np.array([1, 0]),
        )
        counts, timings = {"corners": 9, "inliers": 4}, {"detect": 1.5, "match": 2.25}
        return Estimate(frame.timestamp_ns, Status.TRACKED, T, "", counts, timings, seen)


@pytest.fixture
def dataset(tmp_path):
    return write_euroc(tmp_path / "drive", wall(4))


@pytest.fixture
def written(tmp_path, dataset):
    seen = []
    result = run(open_sequence(dataset), Scripted(), lambda x, _: seen.append(x))
    assert len(seen) == 4
    out = tmp_path / "runs" / "a.v1.txt"
    write_run(out, result, "scripted", {"gain": 2}, dataset)
    return out


def test_run_survives_the_round_trip(written):
    saved = read_run(written)
    assert saved.estimator == "scripted"
    assert saved.trajectory.timestamps_ns.tolist() == [PERIOD_NS * k for k in (1, 2, 4)]
    assert saved.trajectory.T_ref_frame[:, 0, 3].tolist() == [0, 1, 3]
    frames = saved.frames
    assert [x.value for x in frames.status] == ["start", "tracked", "lost", "tracked"]
    assert frames.reason[2] == 'dark, and "odd"'
    assert list(frames.counts) == ["corners", "inliers"]
    assert np.array_equal(frames.counts["inliers"], [np.nan, 4, np.nan, 4], equal_nan=True)
    assert np.array_equal(frames.timings_ms["match"], [np.nan, 2.25, np.nan, 2.25], equal_nan=True)
    assert (frames.frame_ms >= 0).all()
    tracks = saved.tracks
    assert tracks.frame.tolist() == [1, 1, 3, 3]
    assert tracks.landmark.tolist() == [7, 9, 7, 9]
    assert tracks.pixels[0].tolist() == [1.5, 2.5]
    assert tracks.inlier.tolist() == [True, False] * 2
    assert np.isnan(tracks.disparity_px[1])


def test_run_records_provenance(written, dataset):
    about = json.loads((written.parent / "a.v1.run.json").read_text())
    assert about["settings"] == {"gain": 2}
    assert about["dataset_sha256"] is None
    assert about["versions"]["numpy"] == np.__version__


def test_run_fingerprints_the_manifest(tmp_path, dataset):
    (dataset / "dataset.json").write_text("abc")
    write_run(tmp_path / "x.txt", run(open_sequence(dataset), Scripted()), "s", {}, dataset)
    about = json.loads((tmp_path / "x.run.json").read_text())
    expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert about["dataset_sha256"] == expected  # SHA-256 of "abc", FIPS 180-2 B.1


def test_run_leaves_no_partial_files(written):
    names = {path.name for path in written.parent.iterdir()}
    assert names == {f"a.v1.{x}" for x in ("txt", "frames.csv", "tracks.npz", "run.json")}


class Failing(Scripted):
    """Raises on the fourth frame."""

    def track(self, frame):
        if self.frames == 3:
            raise KeyboardInterrupt
        return super().track(frame)


def test_unfinished_run_is_on_disk_line_by_line(tmp_path, dataset):
    out = tmp_path / "runs" / "c.txt"
    seen = []

    def look(*result):
        unfinished.add(*result)
        seen.append(read_run(tmp_path / "runs" / "c.unfinished.txt"))

    with (
        pytest.raises(KeyboardInterrupt),
        pytest.warns(Remark, match=r"c.unfinished.txt: holds the poses of the 3 frames"),
        UnfinishedRun(out) as unfinished,
    ):
        run(open_sequence(dataset), Failing(), look)
    assert [len(x.frames) for x in seen] == [1, 2, 3]
    assert seen[-1].trajectory.timestamps_ns.tolist() == [PERIOD_NS, 2 * PERIOD_NS]
    assert [x.value for x in seen[-1].frames.status] == ["start", "tracked", "lost"]
    assert (seen[-1].frames.frame_ms >= 0).all()
    assert not out.exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_full_disk_names_the_file_of_the_unfinished_run(tmp_path, dataset):
    (tmp_path / "c.unfinished.txt").symlink_to("/dev/full")
    with pytest.raises(DatasetError, match=r"c.unfinished.txt: cannot be written \(No space"):
        estimate(Named("corner_flow"), dataset, tmp_path / "c.txt")


def test_finished_run_leaves_no_unfinished_files(tmp_path, dataset):
    out = tmp_path / "runs" / "c.txt"
    estimate(Named("corner_flow"), dataset, out)
    names = {path.name for path in out.parent.iterdir()}
    assert names == {f"c.{x}" for x in ("txt", "frames.csv", "tracks.npz", "run.json")}


def test_failed_writing_leaves_the_earlier_run(written, dataset):
    before = {path.name: path.read_bytes() for path in written.parent.iterdir()}
    broken = Run("x", (), (), FinalResult(points=PointMap(np.arange(3), None, None, None)))
    with pytest.raises(TypeError):
        write_run(written, broken, "s", {}, dataset)
    assert {path.name: path.read_bytes() for path in written.parent.iterdir()} == before


def test_unreadable_images_cost_their_frames(dataset):
    images = sorted((dataset / "mav0" / "cam1" / "data").iterdir())
    images[1].write_bytes(images[1].read_bytes()[:-40])
    cv2.imwrite(str(images[3]), np.zeros((4, 6), np.uint8))
    estimator = Scripted()
    with pytest.warns(Remark, match=f"{images[1].name}: the PNG .* 2 of 4 frames are lost"):
        result = run(open_sequence(dataset), estimator)
    reasons = [x.reason for x in result.estimates]
    assert reasons == ["", "unreadable image", "", "unreadable image"]
    assert estimator.frames == 2


def test_run_without_readable_images_is_refused(dataset):
    sequence = open_sequence(dataset)
    for image in (dataset / "mav0" / "cam0" / "data").iterdir():
        image.write_bytes(b"junk")
    with pytest.raises(ImageError, match="not a readable image"):
        run(sequence, Scripted())


class Reflective(Scripted):
    """Says how sure it is, and looks back at the end."""

    def track(self, frame):
        estimate = super().track(frame)
        if estimate.status is Status.LOST:
            return estimate
        spread = np.diag(np.arange(1.0, 7.0)) * self.frames
        return replace(estimate, covariance=spread, step_covariance=0.5 * spread)

    def finalize(self):
        times = PERIOD_NS * np.array([1, 2, 4])
        points = PointMap(
            np.array([7, 9]),
            np.array([[0.5, -1, 2], [3, 4, 5.25]]),
            np.array([10, 200], np.uint8),
            np.array([3, 12]),
        )
        return FinalResult(Trajectory(times, np.tile(2 * np.eye(4), (3, 1, 1))), points)


def test_run_writes_what_the_estimator_offers(tmp_path, dataset):
    out = tmp_path / "b.txt"
    write_run(out, run(open_sequence(dataset), Reflective()), "reflective", {}, dataset)
    with np.load(tmp_path / "b.covariance.npz") as file:
        assert file["timestamp_ns"].tolist() == [PERIOD_NS * k for k in (1, 2, 3, 4)]
        np.testing.assert_array_equal(file["pose"][3], 4 * np.diag(np.arange(1.0, 7.0)))
        np.testing.assert_array_equal(file["step"][1], np.diag(np.arange(1.0, 7.0)))
        np.testing.assert_array_equal(file["drift"], file["step"])  # a random walk
        assert np.isnan(file["pose"][2]).all()
    assert len(read_trajectory(tmp_path / "b.smoothed.txt")) == 3
    header, _, body = (tmp_path / "b.map.ply").read_bytes().partition(b"end_header\n")
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\nelement vertex 2\n")
    names = [x.split()[2].decode() for x in header.splitlines() if x.startswith(b"property")]
    assert names == ["x", "y", "z", "red", "green", "blue", "views", "landmark"]
    rows = list(struct.iter_unpack("<fffBBBii", body))
    assert rows == [(0.5, -1, 2, 10, 10, 10, 3, 7), (3, 4, 5.25, 200, 200, 200, 12, 9)]


def test_steps_that_smoothing_contradicts_are_marked(tmp_path):
    """Steps of 50 mm; smoothed, the third pose lies 3 mm further on, the next 1.5 mm."""
    T = np.tile(np.eye(4), (5, 1, 1))
    T[:, 2, 3] = 0.05 * np.arange(5)
    better, times = T.copy(), 10**8 * np.arange(5)
    better[2, 2, 3] += 0.003
    better[3:, 2, 3] += 0.0015
    claimed = [Estimate(int(t), Status.TRACKED, x) for t, x in zip(times, T, strict=True)]
    final = FinalResult(Trajectory(times, better))
    out = tmp_path / "c.txt"
    write_run(out, Run("made", tuple(claimed), (1.0,) * 5, final), "made", {}, tmp_path)
    revised = read_run(out).frames.revised
    assert revised == ("", "", "3.0 mm, 0.00°", "", "")
    write_run(out, Run("made", tuple(claimed), (1.0,) * 5), "made", {}, tmp_path)
    assert read_run(out).frames.revised == ("",) * 5


def test_run_removes_companions_of_an_earlier_run(tmp_path, dataset):
    out = tmp_path / "b.txt"
    write_run(out, run(open_sequence(dataset), Reflective()), "reflective", {}, dataset)
    write_run(out, run(open_sequence(dataset), Scripted()), "scripted", {}, dataset)
    kinds = {path.name for path in tmp_path.glob("b.*")}
    assert kinds == {f"b.{x}" for x in ("txt", "frames.csv", "tracks.npz", "run.json")}


def test_frames_of_another_run_are_not_used(written):
    frames = companion(written, "frames.csv")
    head = frames.read_text().splitlines()[0]
    frames.write_text(
        f"{head}\n5,lost,dark,1{',' * head.count('count:')}{',' * head.count('ms:')}\n"
    )
    with pytest.warns(Remark, match=r"frames.csv: has no row for some poses of a.v1.txt"):
        saved = read_run(written)
    assert len(saved.trajectory) == 3
    assert saved.frames is None


def test_file_in_place_of_a_folder_is_named(tmp_path):
    with pytest.raises(DatasetError, match="is a folder, not a file"), replacing(tmp_path):
        pass


def test_trajectory_alone_is_a_run(written):
    for kind in ("frames.csv", "tracks.npz", "run.json"):
        (written.parent / f"a.v1.{kind}").unlink()
    saved = read_run(written)
    assert (saved.estimator, saved.frames, saved.tracks) == ("a.v1", None, None)


@pytest.mark.parametrize("kind", ["frames.csv", "tracks.npz", "run.json"])
@pytest.mark.parametrize("damage", ["junk", "truncated", "empty", "a list"])
def test_damaged_companions_are_reported(written, kind, damage):
    path = written.parent / f"a.v1.{kind}"
    half = path.read_bytes()[: path.stat().st_size // 2]
    path.write_bytes({"junk": b"junk\njunk\n", "truncated": half, "empty": b""}.get(damage, b"[1]"))
    with pytest.raises(TrajectoryError, match=r"a.v1.txt: a companion file is damaged"):
        read_run(written)


def test_estimate_status_and_pose_must_agree():
    with pytest.raises(ValueError, match="status lost"):
        Estimate(0, Status.LOST, np.eye(4))
    with pytest.raises(ValueError, match="status tracked"):
        Estimate(0, Status.TRACKED, None)
