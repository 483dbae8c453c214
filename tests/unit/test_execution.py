"""Checks of a variant before anything is recorded."""

import pytest

from trials.execution.jobs import Job, Recording, Variant
from trials.execution.runner import run_jobs
from vo.contract.errors import DriftyardError


@pytest.mark.parametrize(
    ("variant", "named"),
    [
        (Variant("ours", "drftyard"), "unknown estimator drftyard; valid: corner_flow, driftyard"),
        (Variant("ours", "driftyard", ("matching.aling=false",)), "matching.aling"),
        (Variant("theirs", "nowhere.to.be:Found"), "nowhere"),
    ],
)
def test_run_jobs_invalid_estimator_records_nothing(tmp_path, variant, named):
    office = Recording("office", 0)
    jobs = [Job(office, Variant("baseline", "corner_flow")), Job(office, variant)]
    with pytest.raises(DriftyardError, match=named):
        run_jobs(jobs, tmp_path)
    assert not list(tmp_path.iterdir())
