"""Page and figure of the validity study."""

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from trials.report.figure import INK, SERIES, grid_of_panels, save_figure, tidy
from trials.report.tables import markdown_table
from trials.studies.validity import Validity, results, summary, table
from vo.contract.files import write_text

SIZE_IN = (9.0, 4.2)
CLAIM = "Simulated twins order estimators as real recordings do, and predict their drift."
SETUP = """Each real recording is matched (`driftyard match`): its nearest scene, recorded with the
camera that was found, is its twin. Every estimator runs over the recording and over twins of
several seeds. Drift is the root mean square position error after a rigid fit, over the length of
the path: it is defined for truths of positions, too. A run that fails ranks last."""


def write_study(found: Validity, folder: Path) -> None:
    """Write V1.png and V1.json into a folder."""
    save_figure(folder / "V1.png", SIZE_IN, lambda figure: _draw(figure, found))
    write_text(folder / "V1.json", json.dumps(results(found), indent=1) + "\n")


def page_text(found: Validity, picture: str) -> str:
    """Return the page as Markdown; `picture` is the place of the figure."""
    verdict, sentence = found.finding
    rows = [
        (*cells, ", ".join(variant.overrides) or variant.estimator)
        for cells, variant in zip(table(found)[1], found.variants, strict=True)
    ]
    header = (*table(found)[0], "settings")
    return f"""# Does simulation predict what happens outside?

*{CLAIM}*

{SETUP}

**The claim {verdict.value}.** {sentence}

![Drift on real recordings and on their twins]({picture})

Drift of every estimator on the real recording and on its twins; bars span the seeds, the line is
equality.

{markdown_table(*summary(found), align_numbers=True)}

{markdown_table(header, rows, align_numbers=True)}
"""


def _draw(figure: Figure, found: Validity) -> None:
    panels = grid_of_panels(figure, len(found.recordings), 3)
    for panel, x in zip(panels, found.recordings, strict=True):
        for k, variant in enumerate(found.variants):
            colour, several = SERIES[k % len(SERIES)], x.twins[:, k]
            panel.plot([x.real[k]] * len(several), several, "-", color=colour, lw=1.2)
            panel.plot(x.real[k], x.predicted[k], "o", color=colour, ms=6, label=variant.label)
        usual = float(np.nanmedian(x.real))
        panel.axline((usual, usual), (2 * usual, 2 * usual), color=INK, lw=0.9, ls="--")
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_locator(LogLocator(subs=(2, 5)))
        panel.xaxis.set_minor_formatter("{x:g}")
        tidy(panel, "drift on the recording, %", "drift on its twins, %", f"{x.name}: {x.scene}")
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8
    )
