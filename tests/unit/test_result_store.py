"""Result store: an interrupted study continues, another one starts afresh."""

import json
from dataclasses import asdict

import pytest

from trials.gym.studies.trial_results import ResultStore, TrialResult


def result(layout: int, source: str = "vo") -> TrialResult:
    numbers = {"time_s": 9.5, "driven_m": 4.0, "way_m": 3.9, "left_m": 0.2, "optimal_s": 7.8}
    ends = {"error_m": 0.1, "drift_percent": None, "lost_share": 0.0}
    return TrialResult(
        layout=layout, run=0, localization=source, outcome="success", **numbers, **ends
    )


@pytest.fixture
def out(tmp_path):
    return tmp_path / "deep" / "trials.jsonl"


def test_result_store_continues_an_interrupted_study(out):
    first = ResultStore(out, "study")
    first.add([result(3), result(3, "wheels")])
    assert not out.exists()  # only when it is complete
    second = ResultStore(out, "study")
    assert second.done == {3: [result(3), result(3, "wheels")]}
    second.add([result(1)])
    second.close()
    read = [TrialResult(**json.loads(line)) for line in out.read_text().splitlines()]
    assert read == [result(1), result(3), result(3, "wheels")]
    assert [x.name for x in out.parent.iterdir()] == [out.name]


def test_result_store_of_another_study_starts_afresh(out):
    old = ResultStore(out, "study")
    old.add([result(1)])
    old.close()
    ResultStore(out, "study").add([result(2)])
    other = ResultStore(out, "other study")
    assert other.done == {}
    assert json.loads(out.read_text()) == asdict(result(1))
