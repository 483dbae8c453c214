"""An injected drift is as large as its name says, in position and in heading."""

import math

import numpy as np
import pytest

from trials.evaluation.alignment import Pair
from trials.evaluation.metrics import errors_over_distance
from trials.gym.env.localization import (
    DRIFT_DEG_PER_M,
    DriftLocalization,
    expect_localization,
)
from trials.gym.world.simulation import Snapshot
from vo.contract import se3
from vo.contract.errors import SettingsError


def drifting(percent: float, seed: int = 0, metres: float = 400.0, step_m: float = 0.05) -> Pair:
    """What an injected drift makes of a straight drive."""
    source = DriftLocalization(percent, seed)
    truth = np.tile(np.eye(4), (round(metres / step_m) + 1, 1, 1))
    truth[:, 0, 3] = step_m * np.arange(len(truth))
    poses = [source.update(Snapshot(k, T, (0, 0)), None).T_world_body for k, T in enumerate(truth)]
    return Pair(np.arange(len(truth)), truth, np.array(poses))


@pytest.mark.parametrize("percent", [0.5, 5.0])
def test_drift_of_a_metre_is_the_named_percentage(percent):
    errors = errors_over_distance(drifting(percent), 1.0)
    # The heading adds its share: a random walk of a metre, sideways by sigma / sqrt(3).
    sigma_m = percent / 100 / math.sqrt(math.pi / 2)
    walk_rad = math.radians(DRIFT_DEG_PER_M * percent) * math.sqrt(math.pi / 2)
    rms = math.sqrt(2 * sigma_m**2 + walk_rad**2 / 3)
    assert np.sqrt(np.mean(errors.translation_m**2)) == pytest.approx(rms, rel=0.1)
    turned = np.degrees(errors.rotation_rad.mean())
    assert turned == pytest.approx(DRIFT_DEG_PER_M * percent, rel=0.1)


def test_drift_accumulates_while_turning_on_the_spot():
    turned = se3.exp(np.array([0, 0, 0, 0, 0, 0.1]))
    for percent, right in ((0.0, True), (10.0, False)):
        source = DriftLocalization(percent, 3)
        T = np.eye(4)
        for k in range(30):
            estimate = source.update(Snapshot(k, T, (0, 0)), None)
            last, T = T, T @ turned
        assert np.allclose(estimate.T_world_body, last, atol=1e-9) is right


def test_drift_is_decided_by_the_seed():
    first, again, other = (drifting(5.0, seed, metres=2.0).T_odom_cam for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


@pytest.mark.parametrize("name", ["drift:", "drift:x", "drift:-1", "drift:nan", "drift:5000"])
def test_drift_with_a_wrong_percentage_is_refused(name):
    with pytest.raises(SettingsError, match="expected drift:PERCENT, from 0 to 1000"):
        expect_localization(name)
