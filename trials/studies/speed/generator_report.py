"""Tables of the speed of renderers and generator."""

from collections.abc import Iterator, Sequence

from rich.table import Table

from trials.report.tables import text_table
from trials.studies.speed.generator import GeneratorSpeed
from trials.studies.speed.renderers import RenderSpeed


def generator_tables(
    generated: Sequence[GeneratorSpeed], rendered: dict[int, RenderSpeed], scaling: float
) -> Iterator[Table]:
    """Tabulate times of rendering alone and with files, then ratios, and their limits.

    Ratios do not depend on the speed of the machine. The generator was measured on all cores before
    and after the renderers, which were on each number of cores; the scaling is the frame rate of
    two on a core each over that of one.
    """
    recorded_ms = sum(x.frame_ms for x in generated) / len(generated)
    alone, spread = rendered[1], rendered[max(rendered)]
    written_ms = spread.stock_left_ms + spread.stock_files_ms
    times_ms: dict[str, list[float]] = {
        "stock, two images, left depth": [x.stock_left_ms for x in rendered.values()],
        "stock, two images, two depths": [x.stock_ms for x in rendered.values()],
        "driftyard, two images, two depths": [x.ours_ms for x in rendered.values()],
        "driftyard, the same of 64 × 48 px": [x.few_pixels_ms for x in rendered.values()],
    }
    rows = [(label, *(f"{x:.1f}" for x in row)) for label, row in times_ms.items()]
    missing = [""] * (len(rendered) - 1)
    rows.append(("stock, images and left depth written", *missing, f"{written_ms:.1f}"))
    rows.append(("driftyard, recorded with noise", *missing, f"{recorded_ms:.1f}"))
    columns = [f"{n} core{'s' * (n > 1)}" for n in rendered]
    yield text_table(("generation, ms per frame", *columns), rows)
    memory_gb = max(x.memory_mb for x in generated) / 1024
    ratios = [
        ("stock over driftyard, two depths, one core", alone.stock_ms / alone.ours_ms, "≥ 1.8"),
        ("the same, if only pixels took time", alone.stock_ms / alone.pixels_ms, ""),
        ("with left depth only of stock", alone.stock_left_ms / alone.ours_ms, ""),
        ("rendering over recording, all cores", spread.ours_ms / recorded_ms, "≥ 0.85"),
        ("stock, written, over recording", written_ms / recorded_ms, ""),
        ("two workers over one, a core each", scaling, "≥ 1.6"),
        ("memory of a worker, GB", memory_gb, "< 1.5"),
    ]
    if len(rendered) > 1:
        every = ("two depths, all cores", spread.stock_ms / spread.ours_ms, "")
        ratios.insert(1, every)
    rows = [(label, f"{found:.2f}", limit) for label, found, limit in ratios]
    yield text_table(("ratio", "found", "required"), rows)
