"""This repository's own gate, and the command line of it."""

import pytest
from terminal import ROOT, driftyard

BASELINE = ROOT / "tests" / "gate" / "baseline.json"
PASS, ERROR, UNDECIDED = 0, 2, 3


@pytest.mark.gl
@pytest.mark.slow
def test_the_default_estimator_has_not_regressed(tmp_path):
    """Renderers differ from machine to machine, so other pictures are accepted."""
    words = ("--accept", "datasets,platform", "--cache", ROOT / "build" / "cache")
    result = driftyard("gate", "--baseline", BASELINE, *words, "--markdown", "c.md", cwd=tmp_path)
    assert result.returncode in (PASS, UNDECIDED), result.stdout + result.stderr
    assert "driftyard against driftyard" in (tmp_path / "c.md").read_text()


def test_bad_input_is_told_in_a_line(tmp_path):
    cases = {
        ("--baseline", "none.json"): "none.json: cannot be read",
        ("--baseline", BASELINE, "--accept", "all"): "--accept: unknown all; valid: datasets",
        ("--baseline", BASELINE, "--plan", "0"): "--plan 0: expected a change",
        ("--baseline", BASELINE, "--seeds", "3"): "--seeds: only with --bless",
        ("--baseline", "b.json", "--bless"): "--bless: needs --scenes; valid: all,",
        ("--baseline", "b.json", "--bless", "--plan", "5%"): "--plan: not with --bless",
        ("--baseline", "b.json", "--bless", "--scenes", "moon"): "moon",
    }
    for words, told in cases.items():
        result = driftyard("gate", *words, cwd=tmp_path)
        assert result.returncode == ERROR, words
        assert told in result.stderr
        assert len(result.stderr.splitlines()) == 1, result.stderr
    assert list(tmp_path.iterdir()) == []
