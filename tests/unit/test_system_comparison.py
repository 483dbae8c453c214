"""The comparison of systems: runs that fail, trajectories of other programs, medians and pages."""

import json
import re

import pytest
from folders import PERIOD_NS, wall, write_euroc
from terminal import driftyard

from trials.estimators.systems.environments import FOLDER_VARIABLE
from trials.execution.jobs import Variant
from trials.execution.variants import parse_estimators, repeated
from trials.studies.systems.comparison import METRICS, About, SystemComparison
from trials.studies.systems.measuring import Drive, Trial, measure, parse_added, read_added
from trials.studies.systems.pages import write_comparison
from vo.contract.errors import SettingsError
from vo.contract.remarks import Remark

FRAMES, STEP_M = 8, 0.25


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Two drives of 1.75 m along x."""
    root = tmp_path_factory.mktemp("drives")
    pairs = wall(FRAMES, 2)
    return [
        Drive("hall", k, write_euroc(root / f"d{k}", pairs, truth_step_m=STEP_M)) for k in (0, 1)
    ]


def write_poses(file, scale=1.0, rows=range(FRAMES)):
    lines = [f"{(i + 1) * PERIOD_NS / 1e9:.9f} {i * STEP_M * scale} 0 0 0 0 0 1" for i in rows]
    file.write_text("\n".join(lines) + "\n")


def test_measure_failures_cost_their_runs_only(drives, tmp_path, monkeypatch):
    """A system that ends at its start, one that is not installed, and one that works."""
    python = tmp_path / "systems" / "toy_vo" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\necho no licence >&2\nexit 3\n")
    python.chmod(0o755)
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "systems"))
    names = ("toy_vo", "openvo", "corner_flow")
    systems = {x: repeated(Variant(x, x), 2) for x in names}
    done = []
    trials = measure(drives[:1], systems, done.append, cache=tmp_path / "cache")
    assert [x.system for x in trials] == ["toy_vo", "openvo", "corner_flow", "corner_flow"]
    assert len(done) == 4
    assert trials[0].problem == "toy_vo ended with exit status 3: no licence"
    assert "`driftyard systems install openvo`" in trials[1].problem
    for x in trials[2:]:
        assert (x.problem, x.lost_percent) == ("", 0.0)
        assert x.score.frame_ms > 0
    assert len(list((tmp_path / "cache" / "runs").glob("*.run.json"))) == 2


def test_repeated_varies_the_seed_or_counts_runs():
    seeds = [x.overrides for x in repeated(Variant("ours", "driftyard", ("stationary=none",)), 2)]
    assert seeds == [("stationary=none", "seed=0"), ("stationary=none", "seed=1")]
    assert [x.repeat for x in repeated(Variant("theirs", "orbslam3"), 3)] == [0, 1, 2]
    assert len(repeated(Variant("theirs", "toy_vo"), 3)) == 1
    assert len(repeated(Variant("theirs", "openvo", ("seed=4",)), 3)) == 1


def test_parse_estimators_names_and_settings():
    found = parse_estimators(["toy_vo,corner_flow", "driftyard stationary=none", "driftyard"])
    labels = ["toy_vo", "corner_flow", "driftyard stationary=none", "driftyard"]
    assert [x.label for x in found] == labels
    (alone,) = parse_estimators(["orbslam3 features=900"])
    assert (alone.label, alone.overrides) == ("orbslam3", ("features=900",))
    for words, complaint in (
        ("toy_v", "unknown estimator toy_v; valid: corner_flow, driftyard, thesis, orbslam3"),
        ("toy_vo gain=2", "has no Settings"),
        ("openvo sede=2", "sede"),
        (" , ", "--estimator: names no estimator"),
    ):
        with pytest.raises(SettingsError, match=complaint):
            parse_estimators([words])


@pytest.mark.parametrize(
    ("texts", "complaint"),
    [
        (["mine"], "--add mine: expected NAME=FOLDER"),
        (["mine=nowhere"], "--add mine=nowhere: no such folder nowhere"),
        (["mine=.", "mine=."], "the name mine occurs twice"),
    ],
)
def test_parse_added_bad_input_is_refused(texts, complaint):
    with pytest.raises(SettingsError, match=re.escape(complaint)):
        parse_added(texts)


def test_read_added_scores_every_run_of_a_drive(drives, tmp_path):
    write_poses(tmp_path / "hall-0.txt", 1.01)
    write_poses(tmp_path / "hall-0.2.txt", 1.02, range(FRAMES - 2))
    (tmp_path / "hall-0.printed.txt").write_text("a log")
    trials = list(read_added("mine", tmp_path, drives))
    assert [(x.drive, x.problem) for x in trials] == [
        ("hall-0", ""),
        ("hall-0", ""),
        ("hall-1", f"{tmp_path} has no hall-1.txt"),
    ]
    lost = [x.lost_percent for x in trials[:2]]
    assert lost == pytest.approx([100 * 2 / FRAMES, 0.0])  # hall-0.2.txt comes first
    drifts = [x.score.drift_pct for x in trials[:2]]
    assert drifts == pytest.approx([2.0, 1.0], rel=1e-6)


def test_read_added_malformed_file_is_a_failure_with_reason(drives, tmp_path):
    (tmp_path / "hall-0.txt").write_text("no poses\n")
    write_poses(tmp_path / "hall-1.txt")
    with pytest.warns(Remark, match=r"hall-0.txt: is not compared"):
        first, second = read_added("mine", tmp_path, drives)
    assert first.score is None
    assert "hall-0.txt" in first.problem
    assert second.score.drift_pct == pytest.approx(0, abs=1e-9)


def test_read_added_folder_of_other_drives_is_refused(drives, tmp_path):
    write_poses(tmp_path / "office-0.txt")
    with pytest.raises(SettingsError, match=r"has no trajectory of a drive; expected hall-0.txt"):
        list(read_added("mine", tmp_path, drives))


@pytest.fixture
def comparison(drives, tmp_path):
    """One program with 1 % and 3 % on two drives, one that failed on one, and one on all."""
    for name, scales in (("one", (1.01, 1.03)), ("half", (1.02,)), ("none", ())):
        (tmp_path / name).mkdir()
        for drive, scale in zip(drives, scales, strict=False):
            write_poses(tmp_path / name / f"{drive.name}.txt", scale)
    trials = [x for name in ("one", "half") for x in read_added(name, tmp_path / name, drives)]
    reason = "<no> `driftyard` licence | none"
    trials += [Trial(x.name, x.scene, "none", None, None, reason) for x in drives]
    about = {name: About("trajectory files", "MIT", "p==1") for name in ("one", "half", "none")}
    command = "driftyard systems compare"
    return SystemComparison(tuple(drives), about, tuple(trials), command, "PC", load=2e4)


def test_comparison_has_medians_intervals_and_failures(comparison):
    header, rows = comparison.summary()
    assert header[:2] == ["system", "drift over 1 m, %"]
    assert rows[0] == ["one", "2.000 (1.000 to 3.000)", "0.0000", "0.0", "–", "2", "0"]
    assert rows[1][1:] == ["2.000", "0.0000", "0.0", "–", "2", "1"]
    assert rows[2][1:] == ["failed"] * len(METRICS) + ["2", "2"]
    assert comparison.by_scene(METRICS[0])[1] == [
        ["hall", "2.000 (1.000 to 3.000)", "2.000, 1 of 2 failed", "failed"]
    ]
    assert [x[:2] for x in comparison.failures] == [("half", "hall-1"), ("none", "all")]
    assert comparison.interval("one", "drift").value == pytest.approx(2.0)
    assert "2.000 (1.000 to 3.000)" in comparison._repr_html_()
    assert "failed" in repr(comparison)


def test_pages_have_tables_failures_and_pictures(comparison, tmp_path):
    page, text, data = write_comparison(comparison, tmp_path / "out")
    html = page.read_text()
    assert "2.000 (1.000 to 3.000)" in html
    assert '<td class="failed">failed</td>' in html
    assert "&lt;no&gt; <code>driftyard</code> licence" in html
    assert html.count("<svg") == len(METRICS)  # no run has lost frames
    assert "No run lost a frame." in html
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", html)
    markdown = text.read_text()
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", markdown):
        assert (text.parent / picture).stat().st_size > 1000
    assert "its load average was 20000. Times are too long" in markdown
    assert "| half | hall-1 | " in markdown
    assert r"| none | all | <no> `driftyard` licence \| none |" in markdown
    made = json.loads(data.read_text())
    assert made["summary"]["one"]["all scenes"]["drift"]["value"] == pytest.approx(2.0)
    assert made["summary"]["none"]["hall"]["drift"]["value"] is None
    assert [x["problem"] for x in made["runs"][-2:]] == ["<no> `driftyard` licence | none"] * 2


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--estimator", "drftyard"], "unknown estimator drftyard; valid: corner_flow"),
        (["--scenes", "offcie"], "--scenes: unknown offcie"),
        (["--add", "mine"], "--add mine: expected NAME=FOLDER"),
    ],
)
def test_compare_bad_input_ends_in_one_line(tmp_path, words, complaint):
    result = driftyard("systems", "compare", *words, cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert complaint in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())
