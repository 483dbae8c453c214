"""Figure of a match: real picture, twin and default picture, and the ratios of their distances."""

from pathlib import Path

from matplotlib.figure import Figure

from trials.realism.camera_match import TARGET, CameraMatch
from trials.realism.quantities import QUANTITIES
from trials.report.figure import BLUE, GREY, INK, RED, save_figure, tidy
from vo.contract.errors import SettingsError

SIZE_IN = (10.0, 5.2)
LIMITS = 0.01, 10.0
"""Ratios beyond these are drawn at them."""


def write_match_figure(match: CameraMatch, out: Path) -> None:
    """Write the figure of a match with scenes as PNG.

    Raises:
        SettingsError: If the name of the file does not end in .png.
        DatasetError: If it cannot be written.
    """
    if out.suffix.lower() != ".png":
        raise SettingsError(f"{out}: the figure is a PNG; name it {out.stem}.png")
    save_figure(out, SIZE_IN, lambda figure: _draw(figure, match))


def _draw(figure: Figure, match: CameraMatch) -> None:
    assert match.comparison is not None
    assert match.default is not None
    grid = figure.add_gridspec(1, 2, width_ratios=(1, 1.15))
    left, right = (figure.add_subfigure(grid[k]) for k in (0, 1))
    shown = (
        (f"real: {match.real}", match.comparison.real),
        (f"twin: {next(iter(match.scenes))}", match.comparison.simulated),
        ("default picture: office, camera ideal", match.default.simulated),
    )
    panels = left.subplots(len(shown), 1)
    for panel, (title, measured) in zip(panels, shown, strict=True):
        panel.imshow(measured.pictures[len(measured.pictures) // 2], cmap="gray", vmin=0, vmax=255)
        panel.set_title(title)
        panel.set_axis_off()
    panel = right.subplots()
    for row, (name, ratio) in enumerate(match.ratios.items()):
        at = min(max(ratio, LIMITS[0]), LIMITS[1])
        colour = GREY if name in match.undecided else BLUE if ratio <= TARGET else RED
        panel.plot([LIMITS[0], at], [row, row], color=colour, lw=1.2, alpha=0.5)
        panel.plot(at, row, "o", color=colour, ms=6)
    names = [QUANTITIES[x].label.partition(",")[0] for x in match.ratios]
    panel.set_yticks(range(len(names)), names)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.set_xscale("log")
    panel.set_xlim(LIMITS[0] / 1.3, LIMITS[1] * 1.3)
    for value, style in ((TARGET, "--"), (1.0, "-")):
        panel.axvline(value, color=INK, ls=style, lw=0.9)
    tidy(panel, "distance to the twin over that to the default picture", "")
    panel.tick_params(axis="y", labelsize=8.5)
    panel.xaxis.set_major_formatter("{x:g}")
