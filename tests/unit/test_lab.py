"""What the lab refuses before it records anything."""

import pytest

from trials.execution.lab import perform
from trials.execution.outcomes import Recording, Trial, Variant
from vo.contract.errors import DriftyardError


@pytest.mark.parametrize(
    ("variant", "named"),
    [
        (Variant("ours", "drftyard"), "unknown estimator drftyard; valid: corner_flow, driftyard"),
        (Variant("ours", "driftyard", ("matching.aling=false",)), "matching.aling"),
        (Variant("theirs", "nowhere.to.be:Found"), "nowhere"),
    ],
)
def test_an_estimator_that_cannot_be_built_costs_no_recording(tmp_path, variant, named):
    office = Recording("office", 0)
    trials = [Trial(office, Variant("baseline", "corner_flow")), Trial(office, variant)]
    with pytest.raises(DriftyardError, match=named):
        perform(trials, tmp_path)
    assert not list(tmp_path.iterdir())
