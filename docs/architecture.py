"""Draw docs/images/architecture.png from the imports of the code: python docs/architecture.py.

Each package is a box, each of its sub-packages a smaller one. An arrow points from a package to one
that it imports; inside a package, arrows that follow from others are left out.
"""

from pathlib import Path

import grimp
import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import FancyBboxPatch

PACKAGES = ("trials", "sim", "vo", "scenes")
CORNERS = {"trials": (0.0, 5.6), "sim": (0.0, 2.1), "vo": (8.6, 0.0), "scenes": (0.0, 0.0)}
SIZES = {"trials": (16.0, 3.4), "sim": (8.0, 2.9), "vo": (7.4, 5.0), "scenes": (8.0, 1.5)}
COLOURS = {"trials": "#4e79a7", "sim": "#59a14f", "vo": "#e15759", "scenes": "#b07aa1"}
OUT = Path(__file__).parent / "images/architecture.png"
SHARED = "vo.contract"


def rooms(graph: grimp.ImportGraph, package: str) -> dict[str, set[str]]:
    """Sub-packages of a package, and which of the others each imports."""
    names = {x for x in graph.find_children(package) if graph.find_children(x)}
    within = {name: {name} | graph.find_descendants(name) for name in names}
    return {
        name: {
            other
            for other in names - {name}
            if any(graph.find_modules_directly_imported_by(x) & within[other] for x in within[name])
        }
        for name in names
    }


def levels(imports: dict[str, set[str]]) -> list[list[str]]:
    """Sub-packages in rows: each above all that it imports; those of a cycle share a row."""
    rows: list[list[str]] = []
    left = dict(imports)
    while left:
        row = [x for x in left if not (left[x] & set(left))]
        row = row or [min(left, key=lambda x: len(left[x] & set(left)))]
        rows.append(sorted(row))
        left = {x: y for x, y in left.items() if x not in row}
    return rows


def draw_package(axes: plt.Axes, package: str, imports: dict[str, set[str]]) -> None:
    """Draw the box of a package with its sub-packages."""
    (x0, y0), (width, height) = CORNERS[package], SIZES[package]
    colour = COLOURS[package]
    box = FancyBboxPatch((x0, y0), width, height, "round,pad=0,rounding_size=0.15")
    box.set(facecolor=colour + "18", edgecolor=colour, linewidth=1.6)
    axes.add_patch(box)
    axes.text(x0 + 0.15, y0 + height - 0.12, package, va="top", weight="bold", color=colour)
    rows = levels(imports)
    step = (height - 0.55) / len(rows)
    places: dict[str, tuple[float, float]] = {}
    for k, row in enumerate(rows):
        for n, name in enumerate(row):
            at = (x0 + width * (n + 0.5) / len(row), y0 + step * (k + 0.5) + 0.1)
            places[name] = at
            label = name.removeprefix(package + ".")
            style = {"boxstyle": "round,pad=0.3", "facecolor": "white", "edgecolor": colour}
            axes.text(*at, label, ha="center", va="center", fontsize=8.5, bbox=style, zorder=3)
    order = [name for row in rows for name in row]
    for name, others in imports.items():
        for other in others:
            implied = any(other in imports[x] for x in others - {other})
            if implied or order.index(other) > order.index(name):
                continue
            arrow = {"arrowstyle": "->", "color": colour, "alpha": 0.55, "shrinkA": 9, "shrinkB": 9}
            axes.annotate("", places[other], places[name], arrowprops=arrow, zorder=2)


def draw_between(axes: plt.Axes, graph: grimp.ImportGraph) -> None:
    """Draw an arrow from each package to each other one that it imports, with their number."""
    inside = {x: {x} | graph.find_descendants(x) for x in (*PACKAGES, SHARED)}
    inside["vo"] -= inside[SHARED]
    arrows = {
        ("trials", "sim"): ((3.0, 5.6), (3.0, 5.0)),
        ("trials", "vo"): ((12.3, 5.6), (12.3, 5.0)),
        ("sim", "scenes"): ((3.0, 2.1), (3.0, 1.5)),
        ("sim", SHARED): ((8.0, 2.6), (8.6, 2.6)),
        ("scenes", SHARED): ((8.0, 0.75), (8.6, 0.75)),
        ("trials", "scenes"): ((8.3, 5.6), (8.05, 1.5)),
    }
    for (source, target), (start, end) in arrows.items():
        count = sum(
            len(graph.find_modules_directly_imported_by(x) & inside[target]) for x in inside[source]
        )
        if not count:
            continue
        arrow = {"arrowstyle": "-|>", "color": "#333333", "linewidth": 1.4}
        axes.annotate("", end, start, arrowprops=arrow, zorder=1)
        middle = [(a + b) / 2 for a, b in zip(start, end, strict=True)]
        note = f"{count}" if target != SHARED else f"{count}\n(contract)"
        axes.text(middle[0] + 0.08, middle[1] + 0.1, note, fontsize=7.5, color="#333333")


def main() -> None:
    """Draw and write the picture."""
    graph = grimp.build_graph(*PACKAGES)
    figure, axes = plt.subplots(figsize=(12.5, 7.4), layout="constrained")
    for package in PACKAGES:
        draw_package(axes, package, rooms(graph, package))
    draw_between(axes, graph)
    axes.set(xlim=(-0.2, 16.2), ylim=(-0.2, 9.2))
    axes.axis("off")
    figure.savefig(OUT, dpi=110)
    print(OUT)


if __name__ == "__main__":
    main()
