"""Shapley values against games of known values, and their description."""

from itertools import permutations

import numpy as np
import pytest

from trials.diagnosis.attribution import (
    REMAINDER,
    SegmentDrifts,
    attribute,
    coalitions,
    shapley,
    summarize,
)
from trials.diagnosis.combinations import RunDrift, paired
from trials.diagnosis.hooks import ErrorInjector, InjectedError
from vo.contract.errors import DatasetError
from vo.contract.sequence import StereoFrame
from vo.hooks import Hooks

STAGES = ("matching", "stereo", "inliers")
AT_M = np.linspace(0, 5, 101)


def game(rng, k=4):
    return {c: rng.uniform(0, 2, k) for c in coalitions(STAGES)}


def additive(name, rng, shares=(0.3, 0.2, -0.1), rest=0.05):
    """Each truth reduces the drift by its share, independent of the others."""
    noise = rng.normal(scale=0.02, size=len(AT_M))
    off = dict(zip(STAGES, shares, strict=True))
    whole = sum(shares) + rest
    return SegmentDrifts(
        name, AT_M, {c: whole - sum(off[x] for x in c) + noise for c in coalitions(STAGES)}
    )


def test_shapley_is_the_mean_gain_over_all_orders():
    """The definition, order by order."""
    values = game(np.random.default_rng(1))
    expected = np.zeros((3, 4))
    for order in permutations(range(3)):
        there = frozenset()
        for i in order:
            expected[i] += (values[there] - values[there | {STAGES[i]}]) / 6
            there |= {STAGES[i]}
    np.testing.assert_allclose(shapley(values, STAGES)[:3], expected, atol=1e-12)


def test_shapley_adds_up_to_the_drift_of_every_segment():
    values = game(np.random.default_rng(2), 50)
    np.testing.assert_allclose(shapley(values, STAGES).sum(axis=0), values[frozenset()])


def test_attribute_recovers_known_shares_in_their_intervals():
    rng = np.random.default_rng(3)
    found = attribute([additive(f"s{i}", rng) for i in range(5)], STAGES)
    assert sum(x.drift.value for x in found.shares) == pytest.approx(found.drift.value)
    assert sum(x.share.value for x in found.shares) == pytest.approx(1)
    assert found.drift.value == pytest.approx(0.45, abs=0.01)
    for share, expected in zip(found.shares, (0.3, 0.2, -0.1, 0.05), strict=True):
        assert share.drift.low - 1e-9 <= share.drift.value <= share.drift.high + 1e-9
        assert share.drift.value == pytest.approx(expected, abs=0.01)
    assert [x.stage for x in found.shares] == [*STAGES, REMAINDER]


def test_attribute_intervals_grow_with_sequence_variance():
    rng = np.random.default_rng(4)

    def width(sigma):
        sequences = [
            additive(str(i), rng, (0.3 + sigma * rng.normal(), 0.2, -0.1)) for i in range(8)
        ]
        drift = attribute(sequences, STAGES).shares[0].drift
        return drift.high - drift.low

    assert width(0.1) == pytest.approx(2 * 1.96 * 0.1 / np.sqrt(8), rel=0.6)
    assert width(0.1) > 3 * width(0.005)


def test_attribute_short_path_has_no_intervals():
    rng = np.random.default_rng(5)
    whole = additive("s", rng)
    short = SegmentDrifts("s", AT_M[:20], {c: x[:20] for c, x in whole.percent.items()})
    found = attribute([short], STAGES)
    assert np.isnan([(x.share.low, x.share.high) for x in found.shares]).all()
    assert "% of the drift comes from matching, " in summarize(found)
    assert "(" not in summarize(found).split(";")[0]


def test_summarize_describes_negative_shares():
    rng = np.random.default_rng(6)
    said = summarize(attribute([additive(name, rng) for name in "ab"], STAGES))
    assert (
        said.index("from matching")
        < said.index("from stereo")
        < said.index("of inliers compensate")
    )
    assert said.startswith(("66 %", "67 %"))
    assert "compensate 22 % (" in said
    assert "; 11 % (1" in said
    assert said.endswith(") is not separated (refinement, sampling).")


def drift(start_ns, lost=0):
    start_ns = np.array(start_ns, dtype=np.int64)
    return RunDrift(start_ns, start_ns / 10.0, start_ns * 2.0, lost, ())


def test_paired_keeps_segments_that_all_runs_have():
    a, b = frozenset(), frozenset(["stereo"])
    found = paired("drive", {a: drift([1, 2, 3, 5]), b: drift([2, 3, 4, 5], 1)})
    np.testing.assert_array_equal(found.percent[a], [4, 6, 10])
    np.testing.assert_array_equal(found.percent[b], [4, 6, 10])
    np.testing.assert_allclose(found.at_m, [0.2, 0.3, 0.5])
    with pytest.raises(DatasetError, match=r"drive: no segment .* lost: {'stereo': 9}"):
        paired("drive", {a: drift([1]), b: drift([2], 9)})


def test_error_injector_adds_each_error_once_per_frame():
    image = np.zeros((8, 8), np.uint8)
    frame, later = StereoFrame(1, image, image), StereoFrame(2, image, image)
    hooks = ErrorInjector(InjectedError(pixel_sigma_px=1.0, disparity_bias_px=0.5), Hooks())
    ids, pixels = np.arange(500), np.random.default_rng(0).uniform(0, 400, (500, 2))
    pixels[7] = np.nan
    once = hooks.pixels(frame, ids, pixels)
    assert np.isnan(once[7]).all()
    assert 0.9 < np.nanstd(once - pixels) < 1.1
    np.testing.assert_array_equal(hooks.pixels(frame, ids, once), once)
    assert 0.9 < np.nanstd(hooks.pixels(later, ids, once) - once) < 1.1
    biased = hooks.disparity(frame, once, np.full(500, 9.0))
    np.testing.assert_array_equal(biased, 9.5)
    np.testing.assert_array_equal(hooks.disparity(frame, once[3:], biased[3:])[:4], 9.5)
