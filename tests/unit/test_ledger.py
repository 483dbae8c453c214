"""The ledger of trials: an interrupted study goes on, another one begins anew."""

import json
from dataclasses import asdict

import pytest

from trials.gym.studies.result_store import Ledger
from trials.gym.studies.trial_protocol import Trial


def trial(layout: int, source: str = "vo") -> Trial:
    numbers = {"time_s": 9.5, "driven_m": 4.0, "way_m": 3.9, "left_m": 0.2, "optimal_s": 7.8}
    ends = {"error_m": 0.1, "drift_percent": None, "lost_share": 0.0}
    return Trial(layout=layout, run=0, localization=source, outcome="success", **numbers, **ends)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "deep" / "trials.jsonl"


def test_what_was_done_before_an_interruption_is_taken_up(out):
    first = Ledger(out, "study")
    first.add([trial(3), trial(3, "wheels")])
    assert not out.exists()  # half a study is none
    second = Ledger(out, "study")
    assert second.done == {3: [trial(3), trial(3, "wheels")]}
    second.add([trial(1)])
    second.close()
    read = [Trial(**json.loads(line)) for line in out.read_text().splitlines()]
    assert read == [trial(1), trial(3), trial(3, "wheels")]
    assert [x.name for x in out.parent.iterdir()] == [out.name]


def test_another_study_begins_anew_and_keeps_the_old_result_until_it_is_done(out):
    old = Ledger(out, "study")
    old.add([trial(1)])
    old.close()
    Ledger(out, "study").add([trial(2)])
    other = Ledger(out, "other study")
    assert other.done == {}
    assert json.loads(out.read_text()) == asdict(trial(1))
