"""Which scene regressed: p-values of single scenes, and the false discovery rate over them."""

import numpy as np
import pytest
from scipy import stats

from trials.gate.baseline import Measurement, Rules
from trials.gate.scene_changes import moderated_p, scene_changes
from trials.studies.gate_power import modelled

SCENES = tuple(f"s{k}" for k in range(6) for _ in range(2))


def measured(drift=0.1, lost=0):
    return Measurement(frames=100, lost_frames=lost, drift_percent=drift)


def changes(after, rules=None):
    before = [measured() for _ in SCENES]
    return {x.scene: x for x in scene_changes(rules or Rules(), SCENES, before, after)}


def test_moderated_p_of_one_sample_is_students():
    values = np.array([0.1, 0.3, 0.2, 0.15])
    expected = stats.ttest_1samp(values, 0.05, alternative="greater").pvalue
    assert moderated_p([values], 0.05) == pytest.approx([expected])


def test_moderated_p_of_equal_variances_has_their_prior():
    """Variances 0.02 with one degree each do not differ more than by chance: one for all.

    Its logarithm is their mean, less digamma(1/2) - log(1/2) = -1.27036, which chance adds to it.
    """
    samples = [np.array([-0.1, 0.1]) + mean for mean in (0.2, 0.0, -0.2)]
    t = 0.2 / np.sqrt(0.02 * np.exp(1.2703628) / 2)
    assert moderated_p(samples, 0.0) == pytest.approx(stats.t.sf([t, 0, -t], 10))


def test_moderated_p_without_differences_or_repetitions():
    none = np.zeros(0)
    assert moderated_p([np.zeros(3), np.array([0.1, 0.2])], 0.0)[0] == 1
    assert np.isnan(moderated_p([np.array([0.3]), np.array([0.1]), none], 0.0)).all()
    found = moderated_p([np.array([0.3]), np.array([0.1, 0.2]), np.array([0.1, 0.3]), none], 0.0)
    assert np.isfinite(found[:3]).all()
    assert np.isnan(found[3])


def test_false_discovery_rate_holds_and_regressions_are_found():
    """Of 14 scenes with two seeds each, three drift 50 % more; tails are those of Student's t."""
    rng, case = np.random.default_rng(0), modelled(14, 0.12, 0.0)
    shift = np.where(np.arange(14) < 3, np.log(1.5), 0.0)
    false, found = [], []
    for _ in range(150):
        values = case.draw(rng, 14, 2) + shift[:, None]
        named = stats.false_discovery_control(moderated_p([*values], 0.0)) <= 0.05
        false.append(named[3:].sum() / max(named.sum(), 1))
        found.append(named[:3].mean())
    assert np.mean(false) < 0.05 + 2 * np.std(false) / np.sqrt(len(false))
    assert np.mean(found) > 0.75


def test_false_alarms_without_any_change_are_rare():
    rng, case = np.random.default_rng(1), modelled(30, 0.12, 0.0)
    named = [
        stats.false_discovery_control(moderated_p([*case.draw(rng, 30, 2)], 0.0)).min() <= 0.05
        for _ in range(150)
    ]
    assert np.mean(named) <= 0.05 + 2 * np.sqrt(0.05 * 0.95 / 150)


def test_scene_changes_name_the_scene_that_regressed():
    rng = np.random.default_rng(2)
    ratios = np.exp(rng.normal(0, 0.03, 12)) * np.where(np.arange(12) // 2 == 4, 1.5, 1.0)
    found = changes([measured(0.1 * x) for x in ratios])
    assert [name for name, x in found.items() if x.has_regressed] == ["s4"]
    assert found["s4"].mean == pytest.approx(np.log(ratios[8:10]).mean())
    assert found["s4"].before == pytest.approx(0.1)
    assert found["s4"].q >= found["s4"].p
    assert found["s0"].verdict == ""


def test_scene_whose_sequences_are_all_newly_lost_is_named():
    after = [measured(lost=50 if k < 2 else 0) for k in range(12)]
    found = changes(after)
    assert found["s0"].verdict == "lost"
    assert (found["s0"].pairs, found["s0"].newly_lost) == (0, 2)
    assert found["s1"].verdict == ""
    assert np.isnan(found["s1"].p) == np.isnan(found["s1"].q)
