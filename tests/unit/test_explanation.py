"""Text and tables of an explanation."""

import io
import json
from dataclasses import replace

import numpy as np
from rich.console import Console

from trials.diagnosis.attribution import REMAINDER, Attribution, Share
from trials.diagnosis.bound import Bound
from trials.diagnosis.combinations import Subject
from trials.diagnosis.explanation import Explanation
from trials.estimators.choice import Named
from trials.evaluation.consistency import Nees
from trials.evaluation.intervals import Interval
from trials.report.explanation_page import (
    NEES_HEAD,
    describe,
    share_rows,
    terminal_report,
    write_explanations,
)
from vo.contract.estimator import Status


def explained(attribution: Attribution | None) -> Explanation:
    """A drive with 0.4 % of drift over all its segments, which not all runs have."""
    return Explanation("dusk", ("one",), (), (), attribution, (0.4,), 0, (), (), Subject(), {})


def test_describe_and_table_give_the_sum_of_the_shares():
    shares = tuple(
        Share(stage, Interval(points, points, points), Interval(*3 * (points / 0.3,)))
        for stage, points in (("matching", 0.2), (REMAINDER, 0.1))
    )
    found = explained(Attribution(Interval(0.3, 0.3, 0.3), shares, {}))
    assert describe(found).startswith("0.300 % of drift over 1 m.")
    assert share_rows(found)[0][1].startswith("0.300")


def test_describe_without_shares_gives_the_drift_of_all_segments():
    assert describe(explained(None)).startswith("0.400 % of drift over 1 m; ")


def test_page_names_estimator_and_settings_that_were_run(tmp_path):
    toml = tmp_path / "own.toml"
    toml.write_text("seed = 4\n[ransac]\niterations = 30\n")
    choice = Named("thesis", toml, ("seed=5", "stereo.method=dense"))
    settings = {"seed": 5, "ransac": {"iterations": 30}, "stereo": {"method": "dense", "size": 3}}
    found = replace(explained(None), subject=Subject(choice, 0.5), settings=settings)
    page, data, *_ = write_explanations([found], tmp_path / "out", tmp_path / "explain.md")
    told = " ".join(page.read_text().split())
    assert (
        "All results are of the estimator `thesis` with `seed=5`, `ransac.iterations=30`, "
        '`stereo.method="dense"` and otherwise its default settings, with noise of 0.5 px '
        "added to the ground truth, on 1 dataset." in told
    )
    (scene,) = json.loads(data.read_text())
    assert (scene["estimator"], scene["settings"]) == ("thesis", settings)
    assert scene["oracle_noise_px"] == 0.5
    assert "estimator `driftyard` with its default settings" in next(
        terminal_report([explained(None)])
    )


def test_terminal_report_fits_80_columns_with_whole_words():
    wide = Interval(-0.123, -0.123, 0.123), Interval(-1.1, -1.123, 1.123)
    shares = tuple(Share(x, *wide) for x in ("prediction", REMAINDER))
    bound = Bound(0.123, 0.012, 0.0123, 0.001, (0.12,) * 3, (-0.12,) * 3, 9000)
    errors = np.full(9000, 123.4)
    nees = Nees(np.arange(9000), (Status.TRACKED,) * 9000, errors, errors, errors)
    attribution = Attribution(Interval(0.123, 0.123, 0.456), shares, {})
    found = replace(
        explained(attribution),
        name="brick_court",
        bounds=(bound,),
        nees=(nees,),
    )
    text = io.StringIO()
    console = Console(file=text, width=80)
    for part in terminal_report([found]):
        console.print(part)
    lines = text.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert {word for head in NEES_HEAD for word in head.split()} <= set(text.getvalue().split())
    assert "…" not in text.getvalue()
