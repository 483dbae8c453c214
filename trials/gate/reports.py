"""Result of the gate: text for the terminal; JSON, Markdown for a pull request, JUnit for CI."""

import json
from typing import Any
from xml.etree import ElementTree

import numpy as np

from trials.gate.comparison import Comparison
from trials.gate.decision import Change, Finding, Verdict, percent
from trials.gate.scene_changes import SceneChange
from trials.gate.statistics import scenes_needed, seeds_needed

KIND, SCHEMA_VERSION = "driftyard gate result", 1
MARKS = {Verdict.PASS: "✅", Verdict.REGRESS: "❌", Verdict.UNDECIDED: "⚠️"}
TITLES = {"drift": "drift, %", "losses": "lost, %", "time": "time", "nees": "NEES"}
HEADER = ("figure", "baseline", "now", "change", "bounds", "finds", "verdict")
SCENE_HEADER = (
    "drift by scene",
    "pairs",
    "baseline, %",
    "change",
    "p",
    "q",
    "newly lost",
    "verdict",
)


def rows(found: Comparison) -> list[tuple[str, ...]]:
    """List cells under HEADER, a row for each figure."""
    return [_row(x) for x in found.decision.findings]


def scene_rows(found: Comparison) -> list[tuple[str, ...]]:
    """List cells under SCENE_HEADER, a row for each scene, the least probable increase first.

    Empty if nothing can be said of single scenes: there is one, or one sequence of each.
    """
    changes = found.scene_changes
    if len(changes) < 2 or not any(np.isfinite(x.p) for x in changes):
        return []
    return [
        (
            x.scene, str(x.pairs), _number(x.before),
            percent(x.mean, signed=True) if x.pairs else "–", _number(x.p), _number(x.q),
            str(x.newly_lost or ""), x.verdict,
        )
        for x in sorted(changes, key=lambda x: (np.nan_to_num(x.p, nan=-1 if x.verdict else 2)))
    ]  # fmt: skip


def regressed_scenes(found: Comparison) -> str:
    """Name the scenes that regressed by themselves, in one line."""
    named = [f"{x.scene} ({percent(x.mean, signed=True)})" for x in found.scene_changes
             if x.has_regressed]  # fmt: skip
    rate = f"false discovery rate {found.baseline.rules.level:.0%}"
    return f"scenes whose drift regressed, {rate}: {', '.join(named) or 'none'}"


def headline(found: Comparison) -> str:
    """State the verdict and its reason in one line."""
    decision = found.decision
    names = f"{decision.verdict.value}: {found.estimator} against {found.baseline.estimator}"
    if decision.remark:
        return f"{names}: {decision.remark}"
    if decision.verdict is Verdict.PASS:
        return f"{names}: drift {decision.findings[0].why}"
    same = [x for x in decision.findings if x.verdict is decision.verdict]
    return f"{names}: {'; '.join(f'{x.figure} {x.why}' for x in same)}"


def notes(found: Comparison) -> list[str]:
    """List what the table leaves out: design, meaning of the columns, lost sequences."""
    rules, drift = found.baseline.rules, found.decision.findings[0].change
    scenes = found.baseline.scenes
    by_scene = drift is not None and drift.tested.by_scene
    sample = "scenes are the samples" if by_scene else "holds for these scenes alone"
    margins = {"drift": rules.drift_margin, "time": rules.time_margin, "NEES": rules.nees_margin}
    lines = [
        f"{len(scenes)} sequences of {len(set(scenes))} scenes; {sample}",
        "drift over 1 m; share of sequences lost; time of a frame over "
        f"{found.baseline.reference}'s; NEES over its expectation",
        f"bounds hold with {1 - rules.level:.0%} each, by Student's t; of drift by bootstrap: "
        f"{_bounds(drift.bootstrap) if drift else '–'}",
        f"'finds' is the smallest increase that is found with a probability of {rules.power:.0%}",
        f"increases that may pass: {', '.join(f'{x} {y:.0%}' for x, y in margins.items() if y)}",
    ]
    if drift is not None and drift.counted:
        size = percent(float(np.abs(drift.effect.values).max()), signed=True)
        lines.append(
            f"few sequences remain: newly lost ones ({drift.counted}) count as {size} of drift, "
            f"whose bounds hold with {1 - drift.level:.2%} each"
        )
    if scene_rows(found):
        lines.append(regressed_scenes(found))
    lines += [f"accepted: {x}" for x in found.mismatches]
    for known, now in zip(found.baseline.sequences, found.measured, strict=True):
        if now.is_lost:
            news = "lost, as before" if known.measured.is_lost else "newly lost"
            loss = now.problem or f"{now.lost_frames} of {now.frames} frames"
            lines.append(f"{known.scene} seed {known.seed}: {news} ({loss})")
    return lines


def plan_line(found: Comparison, change: float) -> str:
    """State how many sequences it takes to find a log ratio of drift, given this result."""
    rules, drift = found.baseline.rules, found.decision.findings[0].change
    wanted = f"to find +{percent(change)} of drift with {rules.power:.0%}"
    if drift is None or drift.effect.degrees < 1:
        return f"{wanted}: too few sequences to estimate a variance"
    if drift.effect.error == 0:
        return f"{wanted}: unknown, because these estimators do not differ on any sequence"
    effect, present = drift.effect, len(set(drift.effect.scenes))
    each = max(1, round(len(effect.values) / present))
    wish = (change - drift.null, rules.level, rules.power)
    seeds = seeds_needed(effect.within, effect.between, present, *wish)
    more = scenes_needed(effect.within, effect.between, each, *wish)
    deviation = 100 * np.hypot(effect.between, np.nan_to_num(effect.within))
    options = [
        f"{seeds} seeds of each of the {present} scenes" if seeds else "",
        f"{more} scenes with {each} each" if more else "",
    ]
    designs = " or ".join(x for x in options if x) or "no design of reasonable size suffices"
    single = "; more than one seed a scene separates both" if each == 1 else ""
    return f"{wanted}: {designs} (standard deviation {deviation:.1f} %){single}"


def _row(finding: Finding) -> tuple[str, ...]:
    title = TITLES[finding.figure]
    scale, digits = (100, 0) if finding.figure == "losses" else (1, 3)
    levels = (
        f"{scale * x:.{digits}f}" if np.isfinite(x) else "–"
        for x in (finding.before, finding.after)
    )
    change = finding.change
    if change is None:
        return (title, *levels, "", "", "", finding.verdict.value)
    mean = percent(change.effect.mean, signed=True) if np.isfinite(change.effect.mean) else "–"
    finds = percent(change.detectable, signed=True) if np.isfinite(change.detectable) else "–"
    return (title, *levels, mean, _bounds((change.low, change.high)), finds, finding.verdict.value)


def _bounds(bounds: tuple[float, float]) -> str:
    if not np.isfinite(bounds).all():
        return "–"
    low, high = (percent(x, signed=True) for x in bounds)
    return f"{low.removesuffix(' %')} to {high}"


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
        "scenes": [_scene(x) for x in found.scene_changes],
        "sequences": [
            {"scene": known.scene, "seed": known.seed}
            | {"baseline": known.measured.model_dump(), "now": now.model_dump()}
            for known, now in zip(found.baseline.sequences, found.measured, strict=True)
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def as_markdown(found: Comparison) -> str:
    """Format a comment for a pull request."""
    verdict = found.decision.verdict
    lines = [f"### {MARKS[verdict]} driftyard gate: {verdict.value}", "", _plain(headline(found))]
    lines += ["", _table_line(HEADER), "|" + "---|" * len(HEADER)]
    lines += [_table_line(row) for row in rows(found)]
    lines += ["", *(f"- {_plain(x)}" for x in notes(found))]
    if table := scene_rows(found):
        lines += ["", "<details><summary>scenes</summary>", "", _table_line(SCENE_HEADER)]
        lines += ["|" + "---|" * len(SCENE_HEADER), *map(_table_line, table), "", "</details>"]
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


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "figure": finding.figure,
        "verdict": finding.verdict.value,
        "why": finding.why,
        "baseline": _finite(finding.before),
        "now": _finite(finding.after),
        "change": _change(finding.change) if finding.change else None,
    }


def _change(change: Change) -> dict[str, Any]:
    """Format a change with its statistics, as ratios; None if unknown."""

    def ratio(log_ratio: float) -> float | None:
        return _finite(float(np.exp(log_ratio)))

    effect = change.effect
    return {
        "ratio": ratio(effect.mean),
        "bounds": [ratio(change.low), ratio(change.high)],
        "bootstrap_bounds": [ratio(x) for x in change.bootstrap],
        "detectable_ratio": ratio(change.detectable),
        "sequences": len(effect.values),
        "counted_losses": change.counted,
        "samples_are": "scenes" if change.tested.by_scene else "sequences",
        "degrees_of_freedom": change.tested.degrees,
        "log_ratios": effect.values.tolist(),
        "scenes": list(effect.scenes),
    }


def _scene(change: SceneChange) -> dict[str, Any]:
    return {
        "scene": change.scene,
        "sequences": change.pairs,
        "newly_lost": change.newly_lost,
        "drift_percent": _finite(change.before),
        "ratio": _finite(float(np.exp(change.mean))),
        "p": _finite(change.p),
        "q": _finite(change.q),
        "verdict": change.verdict,
    }


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "–"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _table_line(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(_plain(x) for x in cells) + " |"


def _plain(text: str) -> str:
    """Escape text for Markdown."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("@", "@\u200b")
