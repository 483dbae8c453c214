"""Estimators from outside: classes that fail, and programs that may do anything."""

import sys
import time

import numpy as np
import pytest
from folders import PERIOD_NS, wall, write_euroc

from trials.estimators.choice import Named, estimate
from trials.estimators.plugins import PluginError
from trials.estimators.plugins.classes import MAX_FAILURES, Guarded
from trials.estimators.plugins.command import Command, between_keyframes
from trials.evaluation.runs import read_run
from vo.contract.errors import SettingsError
from vo.contract.estimator import Estimate, FinalResult, Status
from vo.contract.remarks import Remark
from vo.contract.sequence import StereoFrame
from vo.contract.trajectory import Trajectory

FRAMES = 5
BLANK = np.zeros((4, 4), np.uint8)


class Scripted:
    """An estimator that says or raises what it is told, in turn."""

    def __init__(self, *answers):
        self.answers = list(answers)

    def track(self, frame):
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer(frame) if callable(answer) else answer


def standing(frame):
    return Estimate(frame.timestamp_ns, Status.TRACKED, np.eye(4))


def track(estimator, times):
    return [estimator.track(StereoFrame(time, BLANK, BLANK)) for time in times]


def test_guarded_exception_loses_one_frame():
    guarded = Guarded(Scripted(standing, ValueError("too\n dark"), standing))
    estimates = track(guarded, range(3))
    assert [x.status.value for x in estimates] == ["tracked", "lost", "tracked"]
    assert estimates[1].reason == "ValueError: too dark"


def test_guarded_many_consecutive_failures_are_an_error():
    crashes = [KeyError("x")] * MAX_FAILURES
    track(Guarded(Scripted(*crashes, standing, *crashes)), range(2 * MAX_FAILURES + 1))
    message = rf"failed on {MAX_FAILURES + 1} frames in a row, the last at {MAX_FAILURES} ns: Key"
    with pytest.raises(PluginError, match=message):
        track(Guarded(Scripted(*crashes, *crashes)), range(2 * MAX_FAILURES))


def posed(T):
    return lambda frame: Estimate(frame.timestamp_ns, Status.TRACKED, T)


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (None, "TypeError: track returned NoneType instead of an Estimate"),
        (Estimate(77, Status.TRACKED, np.eye(4)), "ValueError: the estimate is of 77 ns"),
        (posed(np.eye(3)), "not a rigid"),
        (posed(np.full((4, 4), np.nan)), "not a rigid"),
        (posed(np.diag([1.0, 1.0, -1.0, 1.0])), "not a rigid"),
        (posed(np.diag([2.0, 2.0, 2.0, 1.0])), "not a rigid"),
        (posed(np.ones((4, 4)) * np.eye(4) + np.eye(4)[:, ::-1] * 0.1), "not a rigid"),
    ],
)
def test_guarded_invalid_estimate_is_lost(answer, reason):
    [estimate] = track(Guarded(Scripted(answer)), [5])
    assert estimate.status is Status.LOST
    assert estimate.timestamp_ns == 5
    assert reason in estimate.reason


def test_guarded_finalize_passes_through_or_is_empty():
    class Wise(Scripted):
        def finalize(self):
            return FinalResult(Trajectory(np.array([3]), np.eye(4)[None]))

    class Confused(Scripted):
        def finalize(self):
            raise RuntimeError("what was it?")

    assert Guarded(Scripted()).finalize() == FinalResult()
    assert Guarded(Wise()).finalize().trajectory.timestamps_ns.tolist() == [3]
    guarded = Guarded(Confused())
    assert guarded.finalize() == FinalResult()
    assert guarded.complaint == "RuntimeError: what was it?"


@pytest.fixture
def dataset(tmp_path):
    return write_euroc(tmp_path / "a drive", wall(FRAMES))


@pytest.fixture
def program(tmp_path):
    """Write a program of Python lines, in which `dataset` and `out` are paths; its command."""

    def write(lines, **options):
        head = "import pathlib, subprocess, sys, time\n"
        head += "dataset, out = map(pathlib.Path, sys.argv[1:])\n"
        (tmp_path / "own program.py").write_text(head + lines)
        words = f"{sys.executable} '{tmp_path}/own program.py' {{dataset}} {{out}}"
        return Command(words, **options)

    return write


PLAIN = """
rows = (dataset / "mav0/cam0/data.csv").read_text().splitlines()[1:]
times = [int(row.split(",")[0]) / 1e9 for row in rows]
lines = [f"{t:.6f} {5 + i} 0 0 0 0 0 1" for i, t in enumerate(times)]
"""


def test_run_command_poses_are_relative_to_the_first(program, dataset, tmp_path):
    command = program(PLAIN + 'print("hello"); out.write_text("\\n".join(lines))', label="mine")
    start = time.perf_counter()
    result = estimate(command, dataset, tmp_path / "x.tum")
    most_ms = 1e3 * (time.perf_counter() - start)
    saved = read_run(tmp_path / "x.tum")
    assert saved.estimator == "mine"
    assert saved.about["settings"]["command"] == command.template
    assert saved.trajectory.timestamps_ns.tolist() == [PERIOD_NS * (i + 1) for i in range(FRAMES)]
    np.testing.assert_array_equal(saved.trajectory.T_ref_frame[:, 0, 3], range(FRAMES))
    assert [x.value for x in saved.frames.status] == ["start"] + ["tracked"] * (FRAMES - 1)
    assert len(set(result.frame_ms)) == 1
    assert 5 / FRAMES < result.frame_ms[0] < most_ms / FRAMES
    assert (tmp_path / "x.printed.txt").read_text() == "hello\n"


def test_run_command_frame_without_pose_is_lost(program, dataset, tmp_path):
    late = "lines[3] = lines[3].replace('.400000', '.402000')\n"
    command = program(PLAIN + late + 'out.write_text("\\n".join(lines[1:]))')
    estimate(command, dataset, tmp_path / "x.tum")
    frames = read_run(tmp_path / "x.tum").frames
    assert [x.value for x in frames.status] == ["lost", "start", "tracked", "lost", "tracked"]
    assert frames.reason[3] == "the command gave no pose"


def test_run_command_of_keyframes_loses_no_frame_between_them(program, dataset, tmp_path):
    command = program(PLAIN + 'out.write_text("\\n".join(lines[::2]))', label="mine")
    with pytest.warns(Remark, match="mine gives poses of keyframes: 2 of 5 frames between them"):
        result = estimate(command, dataset, tmp_path / "x.tum")
    saved = read_run(tmp_path / "x.tum")
    assert [x.value for x in saved.frames.status] == ["start", "tracked", "tracked"]
    assert len(result.frame_ms) == len(result.estimates) == len(saved.trajectory) == 3


def test_remarks_on_a_trajectory_name_its_program(program, dataset, tmp_path):
    milliseconds = "[' '.join([str(1e3 * t), *x.split()[1:]]) for t, x in zip(times, lines)]"
    command = program(PLAIN + f'out.write_text("\\n".join({milliseconds}))', label="mine")
    with pytest.warns(Remark, match="^the trajectory of mine: timestamps are taken as milli"):
        assert len(estimate(command, dataset, tmp_path / "x.tum").trajectory) == FRAMES


@pytest.mark.parametrize(
    ("posed", "unclaimed"),
    [
        ([0, 2, 4, 5, 6, 8], 0),  # two thirds of the frames: a program that loses some
        ([0, 30], 29 + 10),
        ([3, 7, 11, 15, 19, 23, 27, 31], 3 + 7 * 3 + 9),
        ([0, 2, 4, 30, 32], 3 * 1 + 8),  # 2.6 s are a loss: the limit is 1 s here
        ([0, 9, 10], 8),  # the last 3 s are lost
        ([20], 0),
    ],
)
def test_framesbetween_keyframes_are_not_lost_but_long_gaps_are(posed, unclaimed):
    times, found = 10**8 * np.arange(41), np.isin(np.arange(41), posed)
    assert between_keyframes(times, found).sum() == unclaimed


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("pass", "python.* wrote no trajectory; it printed .*x.printed.txt"),
        ("sys.exit('no such camera')", r"failed with exit status 1: no such camera \(all of it in"),
        ("sys.exit(3)", "failed with exit status 3: it printed nothing"),
        ("import os; os.abort()", "failed with signal 6"),
        ("out.write_text('')", "wrote a malformed trajectory, .*holds no poses"),
        ("out.write_text('1 2 3\\n')", "wrote a malformed trajectory, line 1: 3 columns"),
        ("out.write_bytes(bytes([200]) * 9)", "wrote a malformed trajectory, .*holds no poses"),
        ("out.mkdir()", "wrote no trajectory"),
        (
            "out.write_text('1403636579.7 0 0 0 0 0 0 1')",
            "none of its 1 poses is at the time of a frame; its first is at 1403636579700000000 ns",
        ),
    ],
)
def test_run_command_failing_program_is_reported(lines, message, program, dataset, tmp_path):
    with pytest.raises(PluginError, match=message):
        estimate(program(lines), dataset, tmp_path / "x.tum")
    assert [path.name for path in tmp_path.glob("x*")] == ["x.printed.txt"]


def test_run_command_timeout_kills_the_process_group(program, dataset, tmp_path):
    lines = """
print("begun", flush=True)
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
(dataset / "child").write_text(str(child.pid))
time.sleep(60)
"""
    message = r"was stopped after 2 s \(--timeout\)"
    with pytest.raises(PluginError, match=message):
        estimate(program(lines, timeout_s=2), dataset, tmp_path / "x.tum")
    assert (tmp_path / "x.printed.txt").read_text() == "begun\n"
    child = int((dataset / "child").read_text())
    deadline = time.monotonic() + 5
    while is_running(child):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize(
    ("template", "message"),
    [
        ("slam {dataset}", "{out} is missing"),
        ("slam {out}", "{dataset} is missing"),
        ("slam '{dataset} {out}", "No closing quotation"),
    ],
)
def test_command_invalid_template_is_refused(template, message):
    with pytest.raises(SettingsError, match=message):
        Command(template)


def test_run_command_missing_program_is_reported(dataset, tmp_path):
    with pytest.raises(PluginError, match=r"cannot run /nowhere/slam \(No such file"):
        estimate(Command("/nowhere/slam {dataset} {out}"), dataset, tmp_path / "x.tum")


def test_command_words_are_not_read_by_a_shell(tmp_path):
    words = Command("slam --to={out} '$(x)' {dataset}/mav0 {}").words(tmp_path / "a b", tmp_path)
    assert words == ["slam", f"--to={tmp_path}", "$(x)", f"{tmp_path}/a b/mav0", "{}"]


def test_estimate_class_and_program_write_equal_files(program, dataset, tmp_path):
    estimate(Named("corner_flow"), dataset, tmp_path / "a.tum")
    estimate(program(PLAIN + 'out.write_text("\\n".join(lines))'), dataset, tmp_path / "b.tum")
    ours, theirs = ({path.name[2:] for path in tmp_path.glob(f"{stem}.*")} for stem in ("a", "b"))
    assert theirs == ours | {"printed.txt"}


OWN = """
import numpy as np
from vo.contract.estimator import Estimate, Status

class Moody:
    def __init__(self, rig):
        self.frames = 0

    def track(self, frame):
        self.frames += 1
        if self.frames == 3:
            raise ArithmeticError("mood")
        return Estimate(frame.timestamp_ns, Status.TRACKED, np.eye(4))

class Forgetful(Moody):
    def finalize(self):
        raise RuntimeError("what was it?")
"""


def test_estimate_failing_finalize_keeps_the_files(dataset, tmp_path, monkeypatch):
    (tmp_path / "moody_vo.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    estimate(Named("moody_vo:Moody"), dataset, tmp_path / "a.tum")
    frames = read_run(tmp_path / "a.tum").frames
    assert [x.value for x in frames.status] == ["tracked", "tracked", "lost", "tracked", "tracked"]
    assert frames.reason[2] == "ArithmeticError: mood"
    with pytest.raises(PluginError, match=r"b.tum is written, but finalize failed: RuntimeError"):
        estimate(Named("moody_vo:Forgetful"), dataset, tmp_path / "b.tum")
    assert len(read_run(tmp_path / "b.tum").trajectory) == FRAMES - 1
