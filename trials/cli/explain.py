"""Where the drift comes from: explain."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trials.cli.datasets import Config, Overrides

if TYPE_CHECKING:
    from collections.abc import Sequence

    from trials.diagnosis.combinations import Subject


def explain(
    datasets: Annotated[
        list[Path] | None,
        typer.Argument(help="Datasets with labels.depth=true; those of a scene go together."),
    ] = None,
    scene: Annotated[str, typer.Option(help="Or scenes to drive, a,b,c, or all.")] = "",
    seeds: Annotated[int, typer.Option(min=1, help="Drives of each scene, from seed 0 on.")] = 3,
    distance: Annotated[float, typer.Option(min=1.5, help="Of each drive, metres.")] = 4.0,
    stages: Annotated[
        str, typer.Option(help="To tell apart; matching may be split into matches,features.")
    ] = "prediction,matching,stereo,inliers",
    noise: Annotated[
        float, typer.Option(min=0, metavar="PX", help="Standard deviation of the truth put in.")
    ] = 0.0,
    estimator: Annotated[
        str, typer.Option(metavar="NAME", help="driftyard, thesis, or module:Class with hooks.")
    ] = "driftyard",
    out: Annotated[Path, typer.Option(help="Folder for figures and figures' data.")] = Path(
        "explain"
    ),
    page: Annotated[
        Path | None, typer.Option(help="Page to write.", show_default="explain.md in it")
    ] = None,
    validate: Annotated[
        bool, typer.Option("--validate", help="Inject known errors and look who is blamed.")
    ] = False,
    overrides: Overrides = None,
    config: Config = None,
) -> None:
    """Say what each stage costs, how near to the bound the drift is, and if covariances are right.

    Every stage is replaced by the truth, alone and with others; runs are kept in build/cache.
    """
    from trials.cli import console
    from trials.diagnosis.combinations import STAGES, Subject
    from trials.diagnosis.explanation import explain as explain_groups
    from trials.estimators.choice import Named
    from trials.execution.cache import CACHE
    from trials.report.explanation_page import terminal_report, write_explanations
    from vo.contract.errors import SettingsError

    chosen = [x for x in stages.split(",") if x]
    oracles = [oracle for x in chosen for oracle in STAGES.get(x, (x,))]
    if unknown := [x for x in chosen if x not in STAGES]:
        raise SettingsError(f"--stages: unknown {unknown[0]}; valid: {', '.join(STAGES)}")
    if not chosen or len(set(oracles)) < len(oracles):
        raise SettingsError(f"--stages: {stages or 'nothing'}: name each stage once")
    if bool(datasets) == bool(scene):
        raise SettingsError("explain: name datasets, or else --scene")
    groups = _grouped(datasets) if datasets else _driven(scene, seeds, distance)
    subject = Subject(Named(estimator, config, tuple(overrides or ())), noise)
    if validate:
        _validate([x for some in groups.values() for x in some], subject, chosen)
        return
    with console.progress_bar("runs") as progress:
        found = explain_groups(groups, subject, chosen, CACHE, progress)
    for line in terminal_report(found):
        console.out.print(line)
    with console.err.status("figures and page"):
        written = write_explanations(found, out, page or out / "explain.md")
    for path in written:
        console.out.print(f"{path}", markup=False)


def _grouped(datasets: list[Path]) -> dict[str, list[Path]]:
    from vo.contract.dataset import read_manifest

    groups: dict[str, list[Path]] = {}
    for dataset in datasets:
        groups.setdefault(str(read_manifest(dataset)["scene"]["name"]), []).append(dataset)
    return groups


def _driven(scenes: str, seeds: int, distance_m: float) -> dict[str, list[Path]]:
    """Record or reuse drives with depth labels."""
    from trials.cli import console
    from trials.execution.jobs import Recording
    from trials.execution.runner import record_all
    from trials.studies.accuracy import chosen_scenes

    overrides = (f"drive.distance_m={distance_m:g}", "labels.depth=true", "labels.disparity=false",
                 "exposure.subframes_max=12")  # fmt: skip
    drives = [Recording(x, seed, overrides) for x in chosen_scenes(scenes) for seed in range(seeds)]
    groups: dict[str, list[Path]] = {drive.scene: [] for drive in drives}
    with console.counting_bar("drives", len(drives)) as count:
        for row, folder in sorted(record_all(drives), key=lambda found: found[0]):
            groups[drives[row].scene].append(folder)
            count(folder)
    return groups


def _validate(datasets: "Sequence[Path]", subject: "Subject", stages: "Sequence[str]") -> None:
    from trials.cli import console
    from trials.diagnosis.validation import validate
    from trials.execution.cache import CACHE
    from trials.report.explanation_page import validation_table

    with console.progress_bar("runs") as progress:
        findings = validate(datasets, subject, stages, CACHE, progress)
    console.out.print(validation_table(findings))
