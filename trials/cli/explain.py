"""`driftyard explain`: attribution of the drift to the stages of an estimator."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import ClassVar

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, Distance, EstimatorOptions, argument, option
from trials.cli.workers import WorkersOptions
from trials.diagnosis.combinations import STAGES, Subject
from trials.diagnosis.explanation import explain as explain_groups
from trials.diagnosis.explanation import validate
from trials.execution.cache import CACHE
from trials.execution.jobs import Recording
from trials.execution.recording_settings import parse_scenes
from trials.execution.runner import record_all
from trials.report.explanation_page import terminal_report, validation_table, write_explanations
from vo.contract.dataset import read_manifest
from vo.contract.errors import SettingsError


@dataclass(frozen=True)
class DriveOptions:
    """Drives that are recorded for the study."""

    PANEL: ClassVar[str] = "Drives, instead of datasets"
    scene: str = option("", "Scenes to drive through, or all.", metavar="A,B,C")
    seeds: int = option(3, "Number of drives in each, from seed 0.", min=1)
    distance: Distance = 4.0
    camera: Camera = DEFAULT_CAMERA

    def record(self) -> dict[str, list[Path]]:
        """Record or reuse drives with depth labels; dataset folders by scene."""
        overrides = (f"drive.distance_m={self.distance:g}", "labels.depth=true",
                     "labels.disparity=false", "exposure.subframes_max=12")  # fmt: skip
        scenes = parse_scenes(self.scene, "--scene")
        drives = [
            Recording(x, seed, overrides, camera=self.camera)
            for x, seed in product(scenes, range(self.seeds))
        ]
        groups: dict[str, list[Path]] = {drive.scene: [] for drive in drives}
        with console.counting_bar("drives", len(drives)) as count:
            folders = record_all(drives, progress=count)
        for drive, folder in zip(drives, folders, strict=True):
            groups[drive.scene].append(folder)
        return groups


@dataclass(frozen=True)
class AttributionOptions:
    """What the drift is attributed to."""

    PANEL: ClassVar[str] = "Attribution"
    stages: str = option(
        "prediction,matching,stereo,inliers",
        "Stages to attribute to; matching may be split: matches,features.",
        metavar="A,B,C",
    )
    noise: float = option(
        0.0, "Std. dev. of the noise added to the ground truth, px.", min=0, metavar="PX"
    )
    validate: bool = option(
        False, "Validate the attribution by injecting known errors.", "--validate"
    )

    @property
    def chosen_stages(self) -> list[str]:
        """Names of the stages; SettingsError if one is unknown or named twice."""
        chosen = [x for x in self.stages.split(",") if x]
        oracles = [oracle for x in chosen for oracle in STAGES.get(x, (x,))]
        if unknown := [x for x in chosen if x not in STAGES]:
            raise SettingsError(f"--stages: unknown {unknown[0]}; valid: {', '.join(STAGES)}")
        if not chosen or len(set(oracles)) < len(oracles):
            raise SettingsError(f"--stages: {self.stages or 'nothing'}: name each stage once")
        return chosen


def explain(
    drives: DriveOptions,
    attribution: AttributionOptions,
    estimator: EstimatorOptions,
    workers: WorkersOptions,
    datasets: list[Path] = argument(
        [], "Datasets with labels.depth=true; those of a scene are taken together."
    ),
    out: Path = option(Path("explain"), "Folder of figures and their data."),
    page: Path | None = option(
        None, "Markdown page to write.", metavar="FILE", show_default="OUT/explain.md"
    ),
) -> None:
    """Attribute the drift to stages, compare it with the Cramér-Rao bound, check covariances.

    The ground truth replaces every stage, alone and with others; runs are kept in build/cache.
    """
    stages = attribution.chosen_stages
    if bool(datasets) == bool(drives.scene):
        raise SettingsError("explain: name datasets, or else --scene")
    groups: dict[str, list[Path]] = {} if datasets else drives.record()
    for dataset in datasets:
        groups.setdefault(str(read_manifest(dataset)["scene"]["name"]), []).append(dataset)
    subject = Subject(estimator.named, attribution.noise)
    if attribution.validate:
        every = [x for some in groups.values() for x in some]
        with console.progress_bar("runs") as progress:
            findings = validate(every, subject, stages, CACHE, progress)
        console.out.print(validation_table(findings, subject))
        return
    with console.progress_bar("runs") as progress:
        found = explain_groups(groups, subject, stages, CACHE, progress)
    for line in terminal_report(found):
        console.out.print(line)
    with console.err.status("figures and page"):
        written = write_explanations(found, out, page or out / "explain.md")
    for path in written:
        console.out.print(f"{path}", markup=False)
