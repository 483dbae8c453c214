"""What an explanation says of a scene."""

from trials.diagnosis.attribution import REST, Attribution, Share
from trials.diagnosis.explanation import Explanation
from trials.report.explanation_page import share_rows, verdict


def explained(attribution: Attribution | None) -> Explanation:
    """A drive with 0.4 % of drift over all its metres, also those that only some runs survive."""
    return Explanation("dusk", ("one",), (), (), attribution, (0.4,), 0, (), ())


def test_sentence_and_table_name_the_drift_that_the_shares_add_up_to():
    shares = tuple(
        Share(stage, points, (points, points), points / 0.3, (points / 0.3, points / 0.3))
        for stage, points in (("matching", 0.2), (REST, 0.1))
    )
    found = explained(Attribution(0.3, (0.3, 0.3), shares, {}))
    assert verdict(found).startswith("0.300 % of drift over 1 m.")
    assert share_rows([found])[0][1].startswith("0.300")


def test_without_shares_the_drift_is_that_of_all_metres():
    assert verdict(explained(None)).startswith("0.400 % of drift over 1 m; ")
