"""The gate's statistics, its decision, and what it does with estimators that fail."""

import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from folders import wall, write_euroc
from scipy import stats

from trials.cli import console
from trials.estimators.choice import Named
from trials.gate.baseline import (
    Baseline,
    Design,
    Measurement,
    Recorded,
    Rules,
    read_baseline,
    write_baseline,
)
from trials.gate.comparison import Comparison, compare, dataset_mismatch, refuse
from trials.gate.decision import Change, Verdict, decide
from trials.gate.measure import measure
from trials.gate.reports import as_json, as_junit, as_markdown
from trials.gate.statistics import Effect, design_error, detectable, newly_lost, seeds_needed
from trials.studies.gate_power import modelled, repeat
from vo.contract.errors import DatasetError, SettingsError

SCENES = tuple(f"s{k}" for k in range(6))
STEP_M, FRAMES = 0.05, 30


def measured(drift=0.1, lost=0, ms=10.0, nees=1.0):
    return Measurement(
        frames=100, lost_frames=lost, drift_percent=drift, frame_ms=ms, reference_ms=5, nees=nees
    )


def changed(ratios, scenes=SCENES, **after):
    before = [measured() for _ in ratios]
    return decide(Rules(), scenes, before, [measured(0.1 * x, **after) for x in ratios])


def test_bounds_of_many_scenes_are_students_t():
    values = np.random.default_rng(0).normal(0.03, 0.1, 12)
    effect = Effect.of(values, SCENES * 2)
    means = values.reshape(2, 6).mean(axis=0)
    interval = stats.ttest_1samp(means, 0).confidence_interval(0.9)
    assert effect.bounds(0.05) == pytest.approx((interval.low, interval.high))


def test_bounds_of_one_scene_are_those_of_its_pairs():
    """One scene: the plain interval of a mean."""
    values = np.random.default_rng(1).normal(0, 0.1, 8)
    interval = stats.ttest_1samp(values, 0).confidence_interval(0.9)
    assert Effect.of(values, ["a"] * 8).bounds(0.05) == pytest.approx((interval.low, interval.high))


def test_detectable_change_is_found_with_its_power():
    rng = np.random.default_rng(2)
    error, degrees = design_error(0.1, 0.0, 8, 1)
    draws = rng.normal(detectable(error, degrees, 0.05, 0.8), 0.1, (4000, 8))
    found = stats.ttest_1samp(draws, 0, axis=1, alternative="greater").pvalue <= 0.05
    assert np.mean(found) == pytest.approx(0.8, abs=0.025)


def test_seeds_needed_scene_variance_remains():
    assert seeds_needed(0.1, 0.0, 6, 0.05, 0.05, 0.8) is not None
    assert seeds_needed(0.1, 0.2, 6, 0.05, 0.05, 0.8) is None


@pytest.mark.parametrize("scenes", [SCENES, ("a",) * 6, ("a", "b") * 3])
def test_bootstrap_is_bca_of_the_samples(scenes):
    """Samples are scene means, or else pairs about the mean of their scene."""
    values = np.array([0.01, 0.05, -0.02, 0.11, 0.04, 0.3])
    samples = values
    if scenes == ("a", "b") * 3:
        scene_means = values.reshape(3, 2).mean(axis=0)
        samples = values - np.tile(scene_means, 3) + values.mean()
    wanted = stats.bootstrap(
        (samples,), np.mean, n_resamples=2000, confidence_level=0.9, method="BCa",
        rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    found = Effect.of(values, scenes).bootstrap(0.05)
    assert found == pytest.approx((wanted.low, wanted.high))


def test_between_of_one_scene_is_zero():
    assert Effect.of(np.array([0.1, 0.3, 0.2]), ["a"] * 3).between == 0.0


def test_newly_lost_matches_hand_computation():
    """Five newly lost of five: 1/32."""
    assert newly_lost([False], [False]) == (0, 0, 1.0)
    assert newly_lost([False] * 6, [True] * 5 + [False]) == (5, 0, pytest.approx(1 / 32))
    assert newly_lost([True, False], [False, True]) == (1, 1, pytest.approx(0.75))


def test_decide_of_scaled_drifts_gives_each_verdict():
    rng = np.random.default_rng(3)
    noise = np.exp(rng.normal(0, 0.02, 6))
    assert changed(np.ones(6)).verdict is Verdict.PASS
    assert changed(noise).verdict is Verdict.PASS
    assert changed(1.3 * noise).verdict is Verdict.REGRESS
    assert changed(1.05 * np.exp(rng.normal(0, 0.3, 6))).verdict is Verdict.UNDECIDED
    assert changed(noise, ms=20.0).verdict is Verdict.REGRESS
    assert changed(noise, nees=4.0).verdict is Verdict.REGRESS
    assert changed(noise, nees=0.25).verdict is Verdict.REGRESS
    assert changed(noise, lost=50).verdict is Verdict.REGRESS


def test_decide_one_unchanged_sequence_hides_no_increase():
    ratios = np.array([1.0, 1.3, 1.31, 1.29, 1.32, 1.28])
    assert changed(ratios).verdict is Verdict.REGRESS


def test_decide_nees_compares_distances_from_one():
    """Four on both sides is no change, and one instead of four is better."""
    same = np.ones(6)
    for before, after, wanted in ((4, 4, "pass"), (4, 1, "pass"), (0.25, 4, "pass"),
                                  (1, 4, "regress"), (4, 16, "regress")):  # fmt: skip
        sides = ([measured(nees=x) for _ in same] for x in (before, after))
        finding = decide(Rules(), SCENES, *sides).findings[-1]
        assert (finding.figure, finding.verdict.value) == ("nees", wanted), (before, after)


def test_decide_unknown_or_disabled_figure_has_no_finding():
    def figures(rules, **unknown):
        sides = ([measured(**unknown) for _ in SCENES] for _ in range(2))
        return [x.figure for x in decide(rules, SCENES, *sides).findings]

    assert figures(Rules()) == ["drift", "losses", "time", "nees"]
    assert figures(Rules(), nees=None) == ["drift", "losses", "time"]
    assert figures(Rules(nees_margin=0)) == ["drift", "losses", "time"]
    assert figures(Rules(), ms=None) == ["drift", "losses", "nees"]
    assert figures(Rules(time_margin=0)) == ["drift", "losses", "nees"]


def test_change_of_two_pairs_has_no_bounds():
    effect = Effect.of(np.array([0.1, 0.2]), ["a", "b"])
    change = Change.of(effect, effect, Rules(), 0.0)
    assert np.isnan([change.low, change.high, *change.bootstrap, change.detectable]).all()


def with_losses(ratios, lost, lost_before=(), scenes=SCENES[:5]):
    """Scenes of one sequence; those with the given numbers are lost, after or before."""
    before = [measured(0.1 * (k + 1), 50 * (k in lost_before)) for k in range(len(ratios))]
    after = [measured(0.1 * (k + 1) * x, 50 * (k in lost)) for k, x in enumerate(ratios)]
    return decide(Rules(), scenes, before, after)


@pytest.mark.parametrize("increase", [1.59, 2.4, 3.62])
@pytest.mark.parametrize("lost", [(0,), (2, 4), (0, 1, 3)])
def test_decide_five_scenes_weakened_estimator_regresses(increase, lost):
    """It drifts more and loses drives that the baseline keeps."""
    ratios = increase * np.array([1.2, 0.85, 1.05, 0.8, 1.1])
    decision = with_losses(ratios, lost)
    assert decision.verdict is Verdict.REGRESS
    assert decision.findings[0].change.counted == len(lost)
    counted = f"newly lost sequences ({len(lost)}) counted as the largest change"
    assert counted in decision.findings[0].why


def test_decide_few_remaining_pairs_decide_large_changes():
    """Sequences that both lose, or that the candidate no longer loses, are no increases."""
    ratios = np.array([1.5, 1.8, 1.6, 1.7, 1.9])
    for lost, lost_before in (((0,), (0,)), ((), (2,)), ((1, 3), (1, 3)), ((1,), (3,))):
        decision = with_losses(ratios, lost, lost_before)
        assert decision.verdict is Verdict.REGRESS, lost
        assert decision.findings[0].change.counted == 0
    assert with_losses(ratios, (0, 1, 2), (0, 1, 2)).verdict is Verdict.UNDECIDED


def test_decide_new_loss_alone_is_undecided():
    """Equal or smaller drifts beside one newly lost sequence."""
    for ratios in (np.ones(5), np.array([0.9, 1.1, 1.02, 0.97, 1.0])):
        decision = with_losses(ratios, (4,))
        assert decision.verdict is Verdict.UNDECIDED
        assert decision.findings[1].verdict is Verdict.UNDECIDED
    assert with_losses(np.ones(5), (), (4,)).verdict is Verdict.PASS


def test_decide_many_pairs_counts_no_losses():
    """With five pairs left, the decision is that of the pairs."""
    ratios = np.array([1.3, 1.28, 1.33, 1.31, 1.29, 9.0])
    change = with_losses(ratios, (5,), scenes=SCENES).findings[0].change
    assert (change.counted, change.level) == (0, 0.05)
    interval = stats.ttest_1samp(np.log(ratios[:5]), 0).confidence_interval(0.9)
    assert (change.low, change.high) == pytest.approx((interval.low, interval.high))


def test_decide_counted_loss_halves_the_level():
    """It counts as an increase of the size of the largest change, here a decrease."""
    logs = np.array([0.3, -0.5, 0.1, 0.2, 7.0])
    change = with_losses(np.exp(logs), (4,)).findings[0].change
    interval = stats.ttest_1samp([0.3, -0.5, 0.1, 0.2, 0.5], 0).confidence_interval(0.95)
    assert (change.counted, change.level) == (1, 0.025)
    assert (change.low, change.high) == pytest.approx((interval.low, interval.high))
    assert change.effect.mean == pytest.approx(0.025)


def test_decide_increase_everywhere_regresses_beside_a_loss():
    """Four increases and a loss, one of them so large that Student's t finds nothing."""
    ratios = np.array([1.2, 1.3, 1.4, 40.0, 1.0])
    decision = with_losses(ratios, (4,))
    change = decision.findings[0].change
    assert change.low < change.null
    assert decision.verdict is Verdict.REGRESS
    assert with_losses(np.append(ratios[:3], [40.0, 1.5]), ()).verdict is Verdict.UNDECIDED
    assert with_losses(np.append(ratios[1:4], [1.004, 1.0]), (4,)).verdict is Verdict.UNDECIDED
    assert with_losses(ratios, (2, 4), (2,)).verdict is Verdict.UNDECIDED  # four samples


def test_decide_columns_average_the_same_sequences():
    """Their ratio is the change, whatever is lost and however many sequences a scene has."""
    scenes = ("a", "a", "a", "b", "c", "d", "e", "f")
    before = [measured(x, lost, ms=20 * x) for x, lost in zip(
        (5, 0.3, 0.2, 0.7, 0.4, 0.6, 0.8, 3), (0, 0, 0, 0, 0, 0, 0, 60), strict=True)]  # fmt: skip
    after = [measured(x, lost, ms=30 * x) for x, lost in zip(
        (5, 0.4, 0.2, 0.9, 0.5, 0.8, 0.9, 7), (100, 0, 0, 0, 0, 0, 0, 0), strict=True)]  # fmt: skip
    after[3] = Measurement(frames=100, lost_frames=100, problem="died")
    drift, losses, time, _ = decide(Rules(), scenes, before, after).findings
    for finding in (drift, time):
        assert np.log(finding.after / finding.before) == pytest.approx(finding.change.effect.mean)
    wanted = np.exp(np.mean([np.log(0.06) / 2, *np.log([0.4, 0.6, 0.8])]))
    assert drift.before == pytest.approx(wanted)
    assert (losses.before, losses.after) == (1 / 8, 2 / 8)


def test_candidate_leaves_out_no_frame_that_its_baseline_claims():
    keyframes = measured().model_copy(update={"unclaimed_frames": 70})
    assert keyframes.held_to(measured()).is_lost
    assert not keyframes.held_to(keyframes).is_lost


def test_decide_too_few_sequences_is_undecided():
    decision = changed(np.full(4, 9.0), SCENES[:4])
    assert decision.verdict is Verdict.UNDECIDED
    assert "too few sequences" in decision.remark


@pytest.mark.parametrize(
    ("case", "increase", "newly_lost"),
    [(modelled(6, 0.08, 0.03), 1.1, False), (modelled(5, 0.05, 0.03, loss=0.1), 1.6, True)],
    ids=["+10 %", "weakened"],
)
def test_decide_simulated_has_its_level_and_power(case, increase, newly_lost):
    """Room for four standard deviations of 200 repetitions."""
    rng = np.random.default_rng(4)
    calm, risen = (
        np.mean(
            [
                repeat(
                    rng, case.draw(rng, case.scenes, case.seeds) + np.log(x), case.loss, new
                ).verdict
                is Verdict.REGRESS
                for _ in range(200)
            ]
        )
        for x, new in ((1.005, False), (increase, newly_lost))
    )
    assert 0 < calm < 0.05 + 4 * 0.0154
    assert risen > 0.8 - 4 * 0.0283


@pytest.fixture
def baseline():
    return Baseline(
        estimator="a", settings={}, reference="corner_flow", rules=Rules(),
        design=Design(scenes=SCENES), platform="Linux x", generator="1", software={"mujoco": "4"},
        sequences=tuple(
            Recorded(scene=x, seed=0, sha256=x, measured=measured()) for x in SCENES
        ),
    )  # fmt: skip


def test_baseline_written_is_read_back(baseline, tmp_path):
    write_baseline(tmp_path / "b.json", baseline)
    assert read_baseline(tmp_path / "b.json") == baseline


def test_read_baseline_invalid_file_is_refused(baseline, tmp_path):
    file = tmp_path / "b.json"
    with pytest.raises(DatasetError, match="`driftyard gate update` writes one"):
        read_baseline(file)
    for text in ("{", "[]", "[" * 100_000, '{"kind": "driftyard gate result"}'):
        file.write_text(text)
        with pytest.raises(DatasetError, match="not a gate baseline"):
            read_baseline(file)
    content = json.loads(baseline.model_dump_json())
    file.write_text(json.dumps({**content, "schema_version": 7}))
    with pytest.raises(DatasetError, match="schema 7, this program reads 1"):
        read_baseline(file)
    file.write_text(json.dumps({**content, "sequences": content["sequences"][1:]}))
    with pytest.raises(SettingsError, match=r"b\.json: .*not those of design"):
        read_baseline(file)


def test_dataset_mismatch_names_the_cause(baseline):
    same = [x.sha256 for x in baseline.sequences]
    assert dataset_mismatch(baseline, same, "2", {}) == ""
    told = dataset_mismatch(baseline, [*same[:5], "?"], "1", {"mujoco": "5"})
    assert told == "datasets differ in 1 of 6 sequences, the first s5 seed 0 (mujoco is 5, was 4)"
    park = baseline.sequences[0].model_copy(update={"scene": "park.xml"})
    edited = baseline.model_copy(update={"sequences": (park,), "generator": "1"})
    assert dataset_mismatch(edited, ["?"], "1", {}).endswith("seed 0 (park.xml was edited)")


def test_compare_other_platform_is_refused_first(baseline, tmp_path):
    file = tmp_path / "b.json"
    write_baseline(file, baseline)
    with pytest.raises(DatasetError, match=r"b\.json: platform is .*, was Linux x; run"):
        compare(file, Named(), (), tmp_path, console.counting_bar)
    assert list(tmp_path.iterdir()) == [file]


def test_compare_old_setting_in_baseline_names_file_and_key(baseline, tmp_path):
    overrides = ("exposure.eye_offset_ms=1",)
    design, sequence = Design(scenes=("office",), overrides=overrides), baseline.sequences[0]
    sequences = (sequence.model_copy(update={"scene": "office"}),)
    file = tmp_path / "b.json"
    write_baseline(file, baseline.model_copy(update={"design": design, "sequences": sequences}))
    wanted = "b.json: setting exposure.eye_offset_ms is now exposure.right_offset_ms; run"
    with pytest.raises(SettingsError, match=re.escape(wanted)):
        compare(file, Named(), ("platform",), tmp_path, console.counting_bar)
    assert list(tmp_path.iterdir()) == [file]


def test_refuse_mismatch_unless_accepted(tmp_path):
    refuse(tmp_path, "datasets", "datasets differ", ["datasets"])
    refuse(tmp_path, "datasets", "", [])
    with pytest.raises(DatasetError, match="update`, or --accept datasets"):
        refuse(tmp_path, "datasets", "datasets differ", ["platform"])


def test_reports_of_one_comparison_agree(baseline):
    after = [measured(0.2) for _ in SCENES[1:]]
    after.append(Measurement(frames=100, lost_frames=100, problem="died <b>|\n"))
    decision = decide(Rules(), SCENES, baseline.measured, after)
    found = Comparison(baseline, "b", {}, {}, after, decision, ())
    assert json.loads(as_json(found))["verdict"] == "regress"
    markdown = as_markdown(found)
    assert "regress: b against a" in markdown
    assert "s5 seed 0: newly lost (died &lt;b>" in markdown
    suite = ElementTree.fromstring(as_junit(found))
    assert suite.attrib["failures"] == str(len(suite.findall("testcase/failure"))) == "1"
    few = replace(found, decision=replace(decision, remark="too few"))
    assert ElementTree.fromstring(as_junit(few)).attrib["failures"] == "0"


def test_reports_name_counted_losses(baseline):
    after = [*(measured(0.1 * x) for x in (1.9, 2.0, 2.1, 1.8)), *[measured(lost=50)] * 2]
    decision = decide(Rules(), SCENES, baseline.measured, after)
    found = Comparison(baseline, "b", {}, {}, after, decision, ())
    markdown, content = as_markdown(found), json.loads(as_json(found))
    assert "b against a: drift increased by more than 0.5 %, with newly lost sequences" in markdown
    assert (
        "newly lost ones (2) count as +110.0 % of drift, whose bounds hold with 98.75%" in markdown
    )
    change = content["findings"][0]["change"]
    assert (change["counted_losses"], change["sequences"], change["degrees_of_freedom"]) == (
        2,
        4,
        5,
    )
    assert change["ratio"] == pytest.approx(
        content["findings"][0]["now"] / content["findings"][0]["baseline"]
    )


OWN = """
import numpy as np
from vo.contract.estimator import Estimate, Status

class Sliding:
    made = 0

    def __init__(self, rig):
        Sliding.made += 1
        self.fails, self.frames = Sliding.made == 2, 0

    def track(self, frame):
        if self.fails:
            raise ValueError("second")
        T = np.eye(4)
        T[0, 3] = 0.051 * self.frames
        self.frames += 1
        return Estimate(frame.timestamp_ns, Status.TRACKED, T)

class Silent:
    def __init__(self, rig):
        pass

    def track(self, frame):
        return Estimate(frame.timestamp_ns, Status.LOST, None, "blind")

class Hopeless(Silent):
    def track(self, frame):
        raise ValueError("never")
"""


@pytest.fixture
def place(tmp_path, monkeypatch, in_this_process):
    (tmp_path / "gated.py").write_text(OWN)
    monkeypatch.syspath_prepend(str(tmp_path))
    return [
        write_euroc(tmp_path / f"d{k}", wall(FRAMES, seed=k), truth_step_m=STEP_M) for k in range(3)
    ]


def run(name, place):
    return measure(
        Named(f"gated:{name}"),
        Named("corner_flow"),
        place,
        [x.with_suffix(".txt") for x in place],
        lambda _: None,
    )


def test_measure_crash_loses_one_sequence(place):
    first, second, third = run("Sliding", place)
    assert first.drift_percent == third.drift_percent == pytest.approx(2.0)
    assert second.is_lost
    assert "ValueError: second" in second.problem
    assert first.frame_ms
    assert first.reference_ms
    assert first.nees is None


def test_measure_no_pose_is_a_loss(place):
    for found in run("Silent", place):
        assert (found.is_lost, found.lost_frames, found.problem) == (True, FRAMES, "")


def test_measure_failing_everywhere_is_an_error(place):
    with pytest.raises(DatasetError, match=r"failed on every sequence.*ValueError: never"):
        run("Hopeless", place)
