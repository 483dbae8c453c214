"""Draw docs/images/architecture.png from the imports of the code: python docs/architecture.py.

Each package is a column of its parts, and each part stands above all that it imports from the
column. An arrow between packages shows how many imports cross from one to the other.
"""

import ast
import textwrap
from pathlib import Path

import grimp
import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).parent.parent
OUT = ROOT / "docs/images/architecture.png"
COLOURS = {
    "driftyard": "#8a6d3b",
    "trials": "#4e79a7",
    "sim": "#59a14f",
    "scenes": "#b07aa1",
    "vo": "#e15759",
}
WIDTH, GAP, ROW, HEAD = 5.4, 0.5, 0.5, 0.65


def main() -> None:
    """Draw and write the picture."""
    graph = grimp.build_graph(*COLOURS)
    columns = {package: column(graph, package) for package in COLOURS}
    height = HEAD + ROW * max(map(len, columns.values()))
    width = len(columns) * (WIDTH + GAP)
    figure, axes = plt.subplots(figsize=(0.72 * width, 0.72 * (height + 1.3)), layout="constrained")
    for k, (package, parts) in enumerate(columns.items()):
        draw_package(axes, package, parts, k * (WIDTH + GAP), height)
    for k, source in enumerate(columns):
        for j, target in enumerate(list(columns)[k + 1 :], k + 1):
            draw_imports(axes, count(graph, source, target), k, j, height)
    axes.set(xlim=(-0.1, width - GAP + 0.1), ylim=(-0.1, height + 1.3), aspect="equal")
    axes.axis("off")
    figure.savefig(OUT, dpi=110)
    print(OUT)


def column(graph: grimp.ImportGraph, package: str) -> list[list[str]]:
    """Return groups of parts from the top, each above all that it imports; leaves share a row."""
    parts = graph.find_children(package)
    inside = {part: {part} | graph.find_descendants(part) for part in parts}
    imports = {
        part: {other for other in parts - {part} if _imports(graph, inside[part], inside[other])}
        for part in parts
    }
    rows: list[list[str]] = []
    while imports:
        low = sorted(part for part in imports if not imports[part] & set(imports))
        together = [low] if package == "scenes" and len(low) > 4 else [[part] for part in low]
        rows += together
        imports = {part: others for part, others in imports.items() if part not in low}
    return rows[::-1]


def count(graph: grimp.ImportGraph, source: str, target: str) -> int:
    """Return how many imports go from the modules of one package to those of another."""
    inside = ({x} | graph.find_descendants(x) for x in (source, target))
    return _imports(graph, *inside)


def _imports(graph: grimp.ImportGraph, sources: set[str], targets: set[str]) -> int:
    return sum(len(graph.find_modules_directly_imported_by(x) & targets) for x in sources)


def draw_package(
    axes: Axes, package: str, rows: list[list[str]], left: float, height: float
) -> None:
    """Draw the box of a package with a line for each of its parts."""
    colour, tall = COLOURS[package], HEAD + ROW * len(rows)
    box = FancyBboxPatch((left, height - tall), WIDTH, tall, "round,pad=0,rounding_size=0.12")
    box.set(facecolor=colour + "18", edgecolor=colour, linewidth=1.6)
    axes.add_patch(box)
    title = {"va": "center", "weight": "bold", "fontsize": 13, "color": colour}
    axes.text(left + 0.15, height - HEAD / 2, package, **title)
    for k, parts in enumerate(rows):
        y = height - HEAD - ROW * (k + 0.45)
        names = [part.removeprefix(f"{package}.") for part in parts]
        name, role = (names[0], summary(parts[0])) if len(names) == 1 else ("", ", ".join(names))
        axes.text(left + 0.15, y, name, va="center", weight="bold", fontsize=8)
        indent, characters = (2.1, 43) if name else (0.15, 72)
        text = "\n".join(textwrap.wrap(role, characters))
        axes.text(left + indent, y, text, va="center", fontsize=6.8, color="#333333")


def summary(part: str) -> str:
    """Return the first line of a module's docstring."""
    path = ROOT / part.replace(".", "/")
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return (ast.get_docstring(ast.parse(path.read_text())) or "").partition("\n")[0].rstrip(".:")


def draw_imports(axes: Axes, imports: int, source: int, target: int, height: float) -> None:
    """Draw an arrow with the number of imports, in an arc above the columns."""
    if not imports:
        return
    lift = 0.12 * (target - source)
    start, end = (k * (WIDTH + GAP) + WIDTH / 2 for k in (source, target))
    start, end = start + 0.25 * (target - source), end - 0.25 * (target - source)
    y = height + 0.05
    arc = {"arrowstyle": "-|>", "connectionstyle": f"bar,fraction={-lift / (end - start) * 2.2}"}
    axes.annotate("", (end, y), (start, y), arrowprops=arc | {"color": "#555555"})
    label = {"ha": "center", "va": "center", "fontsize": 7.5, "backgroundcolor": "white"}
    axes.text((start + end) / 2, y + lift * 2.2, f"{imports}", **label)


if __name__ == "__main__":
    main()
