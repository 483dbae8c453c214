"""The comparison as HTML page, as Markdown with pictures, and as JSON."""

import json
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from trials.execution.cluster import usable_cores
from trials.report.charts import Chart, legend_of
from trials.report.figure import Draw, save_figure, shared_legend, svg_markup
from trials.report.html import write_html
from trials.report.tables import markdown_table
from trials.studies.systems.comparison import METRICS, Metric, SystemComparison
from trials.studies.systems.drawings import Sized, by_scene, drift_over_time
from vo.contract.files import write_text

TITLE = "Comparison of odometry systems"
METHOD = (
    "A value is the median over drives of the median over the runs of each drive. Systems with a "
    "random seed, and those whose results vary from run to run, run several times over each drive. "
    "Intervals (95 %) are from a bootstrap over drives and their runs; with few drives they are "
    "hardly wider than the range of the values.",
    "Drift and rotation are the mean errors of the motion over all segments of 1 m of true path, "
    "without any alignment. Frames without a pose are not scored, so drift must be read together "
    "with the lost frames. Runs that failed have no value.",
    "Systems have their default settings, unless the table of systems says otherwise. Runs are one "
    "at a time on one core each, to which all threads of a system are confined. The "
    "time per frame is the median, without the loading of images; of systems in a process of their "
    "own, it includes the transfer of the images.",
)
ADDED = (
    "Trajectories that were added ran elsewhere: their time is unknown, or that of another machine."
)
BUSY = 1.5
"""Load average for each core above which runs had to wait for other work."""
HEADINGS = {
    "drift": "Drift by scene",
    "rotation": "Rotation by scene",
    "lost": "Lost frames by scene",
    "time": "Time by scene",
}
SPEED = "Drift over time per frame"
SPEED_CAPTION = "Medians over all scenes with their intervals. Better is lower and further left."
SCENE_CAPTION = "Median and 95 % interval of each system in each scene."


def write_comparison(comparison: SystemComparison, folder: Path) -> list[Path]:
    """Write `comparison.html`, `.md` with pictures in `images/comparison`, and `.json`.

    Returns:
        The three files.
    """
    page, text, data = (folder / f"comparison.{x}" for x in ("html", "md", "json"))
    folder.mkdir(parents=True, exist_ok=True)
    write_html(page, "systems.html.j2", **_content(comparison))
    write_text(text, _markdown(comparison, folder / "images" / "comparison"))
    write_text(data, json.dumps(comparison.to_dict(), indent=1, allow_nan=False) + "\n")
    return [page, text, data]


def _drawn(comparison: SystemComparison) -> list[Metric]:
    """Return the metrics; without lost frames if there are none."""
    has_lost = any(x.lost_percent for x in comparison.trials)
    return [x for x in METRICS if x.name != "lost" or has_lost]


def subtitle(comparison: SystemComparison) -> str:
    """Return what was compared, in a sentence."""
    drives, scenes = len(comparison.drives), len(comparison.scenes)
    return (
        f"{len(comparison.systems)} systems on {drives} {'drive' if drives == 1 else 'drives'} in "
        f"{scenes} {'scene' if scenes == 1 else 'scenes'}; {len(comparison.trials)} runs, on "
        f"{comparison.machine}."
    )


def _method(comparison: SystemComparison) -> list[str]:
    lines = [*METHOD]
    if not any(x.lost_percent for x in comparison.trials):
        lines.append("No run lost a frame.")
    if comparison.load > BUSY * usable_cores():
        lines.append(
            f"The machine was busy with other work: its load average was {comparison.load:.0f}. "
            "Times are too long, and compare only roughly."
        )
    if any(x.what.startswith("trajectory files") for x in comparison.systems.values()):
        lines.append(ADDED)
    return lines


def _content(comparison: SystemComparison) -> dict[str, object]:
    header, rows = comparison.summary()
    charts = [
        _chart(HEADINGS[x.name], comparison, by_scene(comparison, x), SCENE_CAPTION)
        for x in _drawn(comparison)
    ]
    speed = _chart(SPEED, comparison, drift_over_time(comparison), SPEED_CAPTION)
    several = len(comparison.scenes) > 1
    tables = [comparison.by_scene(x) for x in _drawn(comparison)] if several else []
    return {
        "title": TITLE,
        "subtitle": subtitle(comparison),
        "tiles": _tiles(comparison),
        "summary": (header, rows),
        "speed": speed,
        "charts": charts,
        "tables": tables,
        "failures": comparison.failures,
        "systems": comparison.systems,
        "drives": comparison.drives,
        "method": _method(comparison),
        "command": comparison.command,
    }


def _tiles(comparison: SystemComparison) -> list[tuple[str, str, str]]:
    """Return value, what it is and of which system: the best of each metric that has one."""
    tiles = []
    for metric in METRICS:
        values = {x: comparison.interval(x, metric.name).value for x in comparison.systems}
        known = {name: x for name, x in values.items() if x == x}
        if known and metric.name != "lost":
            best = min(known, key=lambda name: known[name])
            tiles.append((f"{known[best]:.{metric.digits}f}", metric.label, best))
    return tiles


def _chart(title: str, comparison: SystemComparison, sized: Sized, caption: str) -> Chart:
    return Chart(title, svg_markup(title, *sized), legend_of(comparison.systems), caption)


def _markdown(comparison: SystemComparison, pictures: Path) -> str:
    pictures.mkdir(parents=True, exist_ok=True)
    place = f"{pictures.parent.name}/{pictures.name}"
    save_figure(pictures / "speed.png", *drift_over_time(comparison))
    parts = [
        f"# {TITLE}",
        subtitle(comparison) + " Made by",
        f"```sh\n{comparison.command}\n```",
        markdown_table(*comparison.summary(), True),
        f"![{SPEED}]({place}/speed.png)",
        SPEED_CAPTION,
        "\n\n".join(_method(comparison)),
    ]
    if comparison.failures:
        rows = [[x.replace("|", r"\|") for x in row] for row in comparison.failures]
        parts += ["## Failures", markdown_table(("system", "drives", "reason"), rows)]
    for metric in _drawn(comparison):
        title, (size_in, draw) = HEADINGS[metric.name], by_scene(comparison, metric)
        save_figure(pictures / f"{metric.name}.png", size_in, partial(_with_legend, draw))
        parts += [f"## {title}", f"![{title}]({place}/{metric.name}.png)"]
        if len(comparison.scenes) > 1:
            parts += [f"{metric.label}:", markdown_table(*comparison.by_scene(metric), True)]
    rows = [(name, x.what, x.license, x.package) for name, x in comparison.systems.items()]
    header = ("system", "what it is", "license", "package")
    parts += ["## Systems", markdown_table(header, rows)]
    return "\n\n".join(parts) + "\n"


def _with_legend(draw: Draw, figure: Figure) -> None:
    draw(figure)
    shared_legend(figure, figure.axes)
