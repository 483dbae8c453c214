"""Result files of the gate: JSON, Markdown for a pull request, JUnit for CI."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from trials.gate.comparison import Comparison
from trials.gate.decision import Finding, Verdict
from trials.gate.tables import HEADER, change_json, headline, notes, rows
from vo.contract.files import write_text

KIND, SCHEMA_VERSION = "driftyard gate result", 1
MARKS = {Verdict.PASS: "✅", Verdict.REGRESS: "❌", Verdict.UNDECIDED: "⚠️"}


def as_json(found: Comparison) -> str:
    """Format all figures, beside those of the baseline."""
    decision = found.decision
    content: dict[str, Any] = {
        "kind": KIND,
        "schema_version": SCHEMA_VERSION,
        "verdict": decision.verdict.value,
        "why": headline(found),
        "estimator": found.estimator,
        "settings": found.settings,
        "software": found.software,
        "baseline": found.baseline.estimator,
        "rules": found.baseline.rules.model_dump(),
        "accepted": found.mismatches,
        "findings": [_finding(x) for x in decision.findings],
        "sequences": [
            {
                "scene": known.scene,
                "seed": known.seed,
                "baseline": known.measured.model_dump(),
                "now": now.model_dump(),
            }
            for known, now in zip(found.baseline.sequences, found.measured, strict=True)
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def as_markdown(found: Comparison) -> str:
    """Format a comment for a pull request."""
    mark = MARKS[found.decision.verdict]
    lines = [
        f"### {mark} driftyard gate: {found.decision.verdict.value}",
        "",
        _plain(headline(found)),
        "",
    ]
    lines += [_table_line(HEADER), "|" + "---|" * len(HEADER)]
    lines += [_table_line(row) for row in rows(found)]
    lines += ["", *(f"- {_plain(x)}" for x in notes(found))]
    return "\n".join(lines) + "\n"


def as_junit(found: Comparison) -> str:
    """Format a test case for each figure: failed if it regressed, skipped if undecided."""
    suite = ElementTree.Element("testsuite", name="driftyard gate")
    counts = {"tests": 0, "failures": 0, "skipped": 0, "errors": 0}
    remark = found.decision.remark
    for finding in found.decision.findings:
        case = ElementTree.SubElement(
            suite, "testcase", classname="gate", name=finding.figure, time="0"
        )
        counts["tests"] += 1
        if remark or finding.verdict is Verdict.UNDECIDED:
            counts["skipped"] += 1
            ElementTree.SubElement(case, "skipped", message=remark or finding.why)
        elif finding.verdict is Verdict.REGRESS:
            counts["failures"] += 1
            ElementTree.SubElement(case, "failure", message=finding.why).text = headline(found)
    suite.attrib.update({name: str(count) for name, count in counts.items()})
    ElementTree.SubElement(suite, "system-out").text = "\n".join([headline(found), *notes(found)])
    ElementTree.indent(suite)
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


WRITERS: dict[str, Callable[[Comparison], str]] = {
    "json": as_json,
    "markdown": as_markdown,
    "junit": as_junit,
}


def write_reports(found: Comparison, files: dict[str, Path | None]) -> None:
    """Write files by kind, a key of WRITERS; None is skipped."""
    for kind, file in files.items():
        if file is not None:
            write_text(file, WRITERS[kind](found))


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "figure": finding.figure,
        "verdict": finding.verdict.value,
        "why": finding.why,
        "baseline": _known(finding.before),
        "now": _known(finding.after),
        "change": change_json(finding.change) if finding.change else None,
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _table_line(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(_plain(x) for x in cells) + " |"


def _plain(text: str) -> str:
    """Escape text for Markdown."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("@", "@\u200b")
