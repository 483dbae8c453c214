"""Attribution on rendered images: injected errors are found, and the command writes its page."""

import csv
import json
import re

import numpy as np
import pytest
from recordings import OFFICE, shared_recording
from terminal import driftyard

from trials.diagnosis import combinations, explanation
from trials.diagnosis.attribution import REMAINDER
from trials.diagnosis.combinations import Subject
from trials.diagnosis.explanation import MIN_ATTRIBUTED, explain, validate
from trials.estimators.choice import Named
from trials.execution.cache import CACHE
from trials.report.explanation_page import validation_table

pytestmark = [pytest.mark.gl, pytest.mark.slow, pytest.mark.usefixtures("in_this_process")]

STAGES = ("matching", "stereo")


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    return shared_recording(tmp_path_factory, "office", 5, OFFICE)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A working directory, whose cache all tests of this module share."""
    return tmp_path_factory.mktemp("explain")


@pytest.fixture(scope="module")
def cache(place):
    return place / CACHE


def ignore(done, total):
    assert 0 < done <= total


def test_injected_error_is_attributed_to_its_stage(drive, cache, monkeypatch):
    """One error of those that the command injects: each costs a run of every combination."""
    name = "baseline 1 % too long"
    monkeypatch.setattr(explanation, "CASES", {name: explanation.CASES[name]})
    (finding,) = findings = validate([drive], Subject(), STAGES[1:], cache, ignore)
    titled = str(validation_table(findings, Subject(Named(overrides=("seed=3",)))).title)
    assert titled == "estimator `driftyard` with `seed=3` and otherwise its default settings"
    assert finding.after.drift.value > 3 * finding.before.drift.value
    assert MIN_ATTRIBUTED <= finding.attributed < 2


def test_explain_gives_shares_bound_and_consistency(drive, cache):
    (found,) = explain({"office": [drive]}, Subject(), STAGES, cache, ignore)
    assert found.attribution is not None
    assert sum(x.share.value for x in found.attribution.shares) == pytest.approx(1)
    assert found.attribution.drift.value == pytest.approx(found.drift[0])
    assert 0 < found.attribution.shares[-1].share.value < 0.7
    (bound,) = found.bounded
    # The bound is that of the mean square: a single drive may have better luck.
    assert 0.5 < bound.over_1m_percent / bound.bound_over_1m_percent < 50
    assert all(0.005 < x < 0.5 for x in bound.noise_px)
    assert np.isfinite(found.pooled("step")).sum() > 20


def test_explain_reuses_cached_runs(drive, cache, monkeypatch):
    explain({"office": [drive]}, Subject(), STAGES, cache, ignore)

    def never(*_):
        raise AssertionError("a run that is there was run again")

    monkeypatch.setattr(combinations, "_run", never)
    explain({"office": [drive]}, Subject(), STAGES, cache, ignore)


def test_estimator_without_hooks_is_inseparable(drive, cache, tmp_path, monkeypatch):
    module = tmp_path / "steps.py"
    module.write_text(
        "from vo.odometry import StereoOdometry\n"
        "class Closed:\n"
        "    def __init__(self, rig):\n"
        "        self._inner = StereoOdometry(rig)\n"
        "    def track(self, frame):\n"
        "        return self._inner.track(frame)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    subject = Subject(Named("steps:Closed"))
    (found,) = explain({"office": [drive]}, subject, STAGES, cache, ignore)
    assert found.attribution is None
    assert found.inseparable == STAGES
    assert len(found.drift) == 1
    (bound,) = found.bounded  # by its tracks alone
    # The bound is that of the mean square: a single drive may have better luck.
    assert 0.5 < bound.over_1m_percent / bound.bound_over_1m_percent < 50


def test_explain_command_writes_page_figures_and_data(drive, place):
    words = ("explain", drive, "--stages", "matching,stereo", "--out", "found")
    result = driftyard(*words, cwd=place)
    assert result.returncode == 0, result.stderr
    out = place / "found"
    page = (out / "explain.md").read_text()
    for figure in ("shares.png", "path.png", "calibration.png"):
        assert (out / figure).stat().st_size > 10_000
        assert f"({figure})" in page
    (found,) = json.loads((out / "explain.json").read_text())
    said = f"{found['drift_percent']['value']:.3f}"
    assert f"{said} % of drift over 1 m" in page  # the sentence
    assert re.search(rf"\| office \| all \| {said}", page)  # and the table
    assert [x["stage"] for x in found["shares"]] == ["matching", "stereo", REMAINDER]
    with (out / "explain.csv").open() as file:
        rows = list(csv.DictReader(file))
    total = [float(x["drift_percent"]) for x in rows]
    assert np.mean(total) == pytest.approx(found["drift_percent"]["value"], abs=1e-4)
    parts = [sum(float(x[k]) for k in ("matching", "stereo", REMAINDER)) for x in rows]
    np.testing.assert_allclose(parts, total, atol=1e-4)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--scene", "office", "--stages", "luck"], "unknown luck; valid: prediction, matching"),
        (["--scene", "office", "--stages", "matching,matches"], "name each stage once"),
        ([], "name datasets, or else --scene"),
        (["nowhere"], "nowhere"),
    ],
)
def test_explain_bad_arguments_end_in_one_line(words, complaint, tmp_path):
    result = driftyard("explain", *words, cwd=tmp_path)
    assert result.returncode == 2
    assert complaint in result.stderr
    assert len(result.stderr.splitlines()) == 1
