"""The validity study: correlation and ratios of known drifts, its page, and what it refuses."""

import json

import cv2
import numpy as np
import pytest
from folders import wall, write_euroc
from scipy import stats
from terminal import driftyard

from trials.studies.experiments.base import Verdict
from trials.studies.validity import (
    VARIANTS,
    Twinned,
    Validity,
    kendall,
    results,
    spearman,
    summary,
    table,
)
from trials.studies.validity_page import page_text, write_study

REAL = 0.5 * 2.0 ** np.arange(len(VARIANTS))


def study(*predicted):
    return Validity(
        [Twinned(f"r{k}", "office", 50, 10.0, REAL, x) for k, x in enumerate(predicted)]
    )


def test_twins_of_equal_order_and_half_the_drift():
    found = study(*[np.vstack([REAL / 4, REAL])] * 5)
    assert found.recordings[0].predicted == pytest.approx(REAL / 2)
    assert found.recordings[0].ratio.value == pytest.approx(0.5)
    assert found.correlation(found.recordings, kendall).value == pytest.approx(1)
    assert found.factor == pytest.approx(2)
    verdict, text = found.finding
    assert verdict is Verdict.PARTLY
    assert "do not predict its size" in text
    assert study(*[1.1 * REAL[None]] * 5).finding[0] is Verdict.HOLDS
    assert study(*[REAL[None, ::-1]] * 5).finding[0] is Verdict.FAILS


def test_few_recordings_leave_it_open_or_say_so():
    shuffled = REAL[None, [3, 0, 6, 1, 7, 2, 5, 4]]
    verdict, text = study(shuffled).finding
    assert verdict is Verdict.OPEN
    assert "1 recording cannot carry a general verdict" in text
    assert "2 recordings cannot carry" in study(REAL[None], REAL[None]).finding[1]


def test_rank_correlations_are_those_of_scipy():
    x, y = np.random.default_rng(3).integers(0, 6, (2, 4, 8)).astype(float)
    for ours, scipys in ((kendall, stats.kendalltau), (spearman, stats.spearmanr)):
        assert ours(x, y) == pytest.approx([scipys(*pair)[0] for pair in zip(x, y, strict=True)])


def test_failed_runs_rank_last():
    failed = np.r_[REAL[:-1], np.nan]
    found = study(failed[None])
    assert found.correlation(found.recordings, kendall).value == pytest.approx(1)
    assert table(found)[1][-1][-1] == "–"


def test_page_and_files_show_every_drift(tmp_path):
    found = study(REAL[None], 2 * REAL[None])
    write_study(found, tmp_path)
    assert cv2.imread(str(tmp_path / "V1.png")) is not None
    saved = json.loads((tmp_path / "V1.json").read_text())
    assert saved == json.loads(json.dumps(results(found)))
    text = page_text(found, "V1.png")
    assert all(x.label in text for x in VARIANTS)
    assert len(summary(found)[1]) == 2


def test_recordings_without_motion_or_name_are_refused_in_a_line(tmp_path):
    write_euroc(tmp_path / "still", wall(2), truth_step_m=0.0)
    for words, said in (
        (("V1",), "V1 needs real recordings with a ground truth: --real a,b,c"),
        (("V1", "--real", "still"), "still: stands still"),
        (("V1", "--real", "nowhere"), "nowhere"),
        (("E1", "--real", "still"), "--real: E1 has no real recordings"),
    ):
        done = driftyard("experiment", *words, cwd=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert said in done.stderr
