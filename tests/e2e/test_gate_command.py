"""The gate on its command line, and this repository's own gate."""

import pytest
from terminal import ROOT, driftyard

BASELINE = ROOT / "tests" / "gate" / "baseline.json"
PASS, ERROR, UNDECIDED = 0, 2, 3
CHECK = ("check", "--baseline", BASELINE)
UPDATE = ("update", "--baseline", "b.json")


@pytest.mark.gl
@pytest.mark.slow
def test_gate_check_default_estimator_has_not_regressed(tmp_path, in_this_process):
    """Renderers differ between machines, so other datasets are accepted."""
    words = ("--accept", "datasets,platform", "--cache", ROOT / "build" / "cache")
    files = ("--markdown", "c.md", "--history", "h.jsonl", "--drive-table", "d.csv")
    result = driftyard("gate", *CHECK, *words, *files, cwd=tmp_path)
    assert result.returncode in (PASS, UNDECIDED), result.stdout + result.stderr
    assert "driftyard against driftyard" in (tmp_path / "c.md").read_text()
    assert "false discovery rate" in result.stdout
    assert len((tmp_path / "d.csv").read_text().splitlines()) == 7
    shown = driftyard("gate", "history", "h.jsonl", cwd=tmp_path)
    assert "no trend" in shown.stdout


def test_gate_bad_input_ends_in_one_line(tmp_path):
    cases = {
        ("check", "--baseline", "none.json"): "none.json: cannot be read",
        (*CHECK, "--accept", "all"): "--accept: unknown all; valid: datasets",
        ("plan", "0", "--baseline", BASELINE): "PERCENT 0: expected a change",
        ("--bless", "--baseline", "b.json"): "--bless` is now `driftyard gate update`",
        ("--baseline", "b.json"): "`driftyard gate` is now `driftyard gate check`",
        UPDATE: "--scenes: names no scene; valid: all,",
        (*UPDATE, "--scenes", "moon"): "--scenes: unknown moon",
        (*UPDATE, "--scenes", "office", "--margin", "0.001"): "drift_margin: must exceed",
    }
    for words, message in cases.items():
        result = driftyard("gate", *words, cwd=tmp_path)
        assert result.returncode == ERROR, words
        assert message in result.stderr
        assert len(result.stderr.splitlines()) == 1, result.stderr
    assert list(tmp_path.iterdir()) == []


def test_gate_check_option_of_update_is_refused(tmp_path):
    result = driftyard("gate", *CHECK, "--seeds", "3", cwd=tmp_path)
    assert result.returncode == ERROR
    assert "No such option: --seeds" in result.stderr
