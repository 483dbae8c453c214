"""Statistics and tables of `driftyard accuracy`."""

from pathlib import Path

import numpy as np
import pytest

from scenes import SCENES
from trials.evaluation.runs import read_run
from trials.evaluation.wrong_steps import WrongSteps, count_wrong_steps
from trials.execution.cache import source_digest
from trials.execution.jobs import Job, Recording, Result, Variant
from trials.execution.recording_settings import parse_scenes
from trials.execution.variants import named_variant
from trials.studies.accuracy import (
    accuracy_table,
    bootstrap_interval,
    consistency_table,
    summary_tables,
    wrong_steps_table,
)
from vo.contract import se3
from vo.contract.errors import SettingsError
from vo.contract.estimator import Estimate, Status
from vo.contract.trajectory import Trajectory
from vo.runner import Run, write_run


def test_bootstrap_interval_of_equal_values_is_a_point():
    assert bootstrap_interval(np.full(5, 0.07)) == (0.07, 0.07)


def test_bootstrap_interval_contains_the_median():
    values = np.array([0.05, 0.09, 0.06, 0.11, 0.07])
    low, high = bootstrap_interval(values)
    assert values.min() <= low <= np.median(values) <= high <= values.max()


@pytest.mark.parametrize("drives", [25, 100])
def test_bootstrap_interval_has_its_nominal_coverage(drives):
    rng = np.random.default_rng(drives)
    covered = 0
    for _ in range(60):
        low, high = bootstrap_interval(rng.exponential(size=drives))
        covered += low <= np.log(2) <= high  # the median of an exponential distribution
    assert 50 <= covered < 60


def test_source_digest_repeated_is_equal():
    assert source_digest() == source_digest()
    assert len(source_digest()) == 12


def result(folder: Path, name: str, seed: int, scale: float | None) -> Result:
    """A straight drive of 3 m, its estimate scaled or entirely lost; the last 4 frames are lost."""
    times = 10**8 * np.arange(65)
    T = np.tile(np.eye(4), (65, 1, 1))
    T[:, 2, 3] = np.minimum(np.arange(65) / 20, 3)
    estimated = T.copy()
    estimated[:, 2, 3] *= scale or 1
    lost = [scale is None or i > 60 for i in range(65)]
    estimates = tuple(
        Estimate(t, Status.LOST, None) if gone else Estimate(t, Status.TRACKED, pose)
        for t, pose, gone in zip(times.tolist(), estimated, lost, strict=True)
    )
    file = folder / f"{name}-{seed}.txt"
    write_run(file, Run("made", estimates, (1.0,) * 65), name, {}, folder)
    made = Result(Job(Recording("office", seed), Variant(name, name)), folder, file)
    vars(made)["truth"] = Trajectory(times, T)
    return made


def test_summary_tables_compare_medians(tmp_path):
    """Three drives: scales wrong by 1, 2 and 6 per mille, the baseline's by 4 each time."""
    runs = [result(tmp_path, "driftyard", k, 1 + x) for k, x in enumerate((0.001, 0.006, 0.002))]
    runs += [result(tmp_path, "corner_flow", k, 1.004) for k in range(3)]
    (table,) = summary_tables({"office": runs})
    (row,) = zip(*(column.cells for column in table.columns), strict=True)
    assert row == ("office", "0.200", "0.600", "0.000", "12", "0.400", "0.50", "12")


def test_summary_tables_one_per_other_estimator(tmp_path):
    scales = {"driftyard": 1.001, "corner_flow": 1.004, "Theirs": 1.01}
    runs = [result(tmp_path, name, 0, scale) for name, scale in scales.items()]
    tables = summary_tables({"office": runs})
    assert [str(x.columns[5].header) for x in tables] == ["corner_flow", "Theirs"]
    rows = [next(zip(*(c.cells for c in x.columns), strict=True)) for x in tables]
    assert [x[5:] for x in rows] == [("0.400", "0.25", "4"), ("1.000", "0.10", "4")]
    assert {x[:5] for x in rows} == {("office", "0.100", "0.100", "0.000", "4")}


def test_accuracy_table_drive_without_poses_has_no_median(tmp_path):
    runs = [result(tmp_path, "driftyard", 0, 1.001), result(tmp_path, "corner_flow", 0, None)]
    (table,) = summary_tables({"office": runs})
    (row,) = zip(*(c.cells for c in table.columns), strict=True)
    assert row == ("office", "0.100", "0.100", "0.000", "4", "–", "–", "65")
    cells = list(accuracy_table("office", runs).columns[2].cells)
    assert cells[0] == "0.100"
    assert cells[7:] == ["–"] * 6 + ["65 of 65"]


def test_named_variant_is_parsed_like_a_shell():
    theirs = named_variant("trials.estimators.systems.orbslam3:OrbSlam3 vocabulary='my words.txt'")
    assert (theirs.label, theirs.overrides) == ("OrbSlam3", ("vocabulary=my words.txt",))
    ours = named_variant("driftyard stationary=none")
    assert (ours.label, ours.estimator) == ("driftyard stationary=none", "driftyard")
    with pytest.raises(SettingsError, match="--against driftyard 'x: No closing quotation"):
        named_variant("driftyard 'x")


def test_parse_scenes_takes_names_or_all():
    assert parse_scenes("office,dusk") == ["office", "dusk"]
    assert parse_scenes("all") == list(SCENES)
    with pytest.raises(SettingsError, match="--scenes: unknown offcie; valid: all, asphalt"):
        parse_scenes("offcie")


def test_wrong_steps_are_counted_by_status_and_sigma(tmp_path):
    """Of 40 steps four are wrong: two in silence, one beyond its sigmas, one after lost frames."""
    times = 10**8 * np.arange(43)
    step = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    truth = np.array([se3.exp(k * step) for k in range(43)])
    errors = {5: ([0.003, 0, 0, 0, 0, 0], Status.TRACKED), 9: ([0, 0, 0.003, 0, 0, 0], Status.WEAK),
              12: ([0, 0, 0, np.radians(0.3), 0, 0], Status.TRACKED)}  # fmt: skip
    lost, right_but_weak = (20, 21), 30
    estimates, T = [], np.eye(4)
    for k, time in enumerate(times.tolist()):
        error, status = errors.get(k, (np.zeros(6), Status.TRACKED))
        T = T @ se3.exp(step) @ se3.exp(np.array(error)) if k else T
        status = Status.START if k in (0, 22) else Status.WEAK if k == right_but_weak else status
        sigma = 0.0004 if k == 5 else 0.002
        if k == 22:
            T = T @ se3.exp(np.array([0.05, 0, 0, 0, 0, 0]))
        known = None if k in lost else T
        estimates.append(
            Estimate(time, Status.LOST if k in lost else status, known,
                     covariance=np.eye(6), step_covariance=sigma**2 * np.eye(6))
        )  # fmt: skip
    file = tmp_path / "made.txt"
    write_run(file, Run("made", tuple(estimates), (1.0,) * 43), "driftyard", {}, tmp_path)
    counted = count_wrong_steps(Trajectory(times, truth), read_run(file))
    assert counted == WrongSteps(steps=40, wrong=4, silent=2, flagged=1, beyond=2, sized=40)
    made = Result(Job(Recording("office", 0), Variant("driftyard")), tmp_path, file)
    vars(made)["truth"] = Trajectory(times, truth)
    table = wrong_steps_table({"office": [made, made]})
    rows = list(zip(*(column.cells for column in table.columns), strict=True))
    assert rows[0] == ("driftyard", "office", "80", "8", "4", "4", "2.50")
    assert rows[1][1:3] == ("all", "80")


def test_consistency_table_has_runs_with_covariances(tmp_path):
    """Errors of three sigma along each of six axes, in steps of 5 cm; the other gives none."""
    times = 10**8 * np.arange(30)
    step = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    truth = np.array([se3.exp(k * step) for k in range(30)])
    sigma, T, estimates = 1e-3, [np.eye(4)], []
    for k in range(1, 30):
        T.append(T[-1] @ se3.exp(step) @ se3.exp((-1) ** k * 3 * sigma * np.ones(6)))
    for time, pose in zip(times.tolist(), T, strict=True):
        C = sigma**2 * np.eye(6)
        estimates.append(Estimate(time, Status.TRACKED, pose, covariance=C, step_covariance=C))
    file = tmp_path / "sized.txt"
    write_run(file, Run("made", tuple(estimates), (1.0,) * 30), "driftyard", {}, tmp_path)
    sized = Result(Job(Recording("office", 0), Variant("driftyard")), tmp_path, file)
    vars(sized)["truth"] = Trajectory(times, truth)
    table = consistency_table({"office": [sized, result(tmp_path, "corner_flow", 0, 1.001)]})
    rows = list(zip(*(c.cells for c in table.columns), strict=True))
    assert [x[:5] for x in rows] == [
        ("driftyard", "office", "29", "54.0", "0"), ("", "all", "29", "54.0", "0")
    ]  # fmt: skip
    assert float(rows[0][5]) < 3  # errors of successive steps cancel
