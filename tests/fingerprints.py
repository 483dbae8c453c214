"""Fingerprints of what the project computes, to hold a change against that must change no number.

    python tests/fingerprints.py make before --checkout ../older
    python tests/fingerprints.py make after
    python tests/fingerprints.py compare before after

`make` calls the command line of a checkout only, so that two revisions with different insides can
be compared: datasets of every scene, disturbed and carried by hand; trajectories, covariances,
tracks and maps of every estimator preset and alternative; a gate, an explanation and a navigation
trial. About fifteen minutes on two cores. Fingerprints hold for one machine: other processors and
OpenGL drivers round differently.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parents[1]
SEED = "3"
SMALL = ("rig.width_px=320", "rig.height_px=240")
SCENES = (
    *("asphalt", "brick_court", "corridor", "crowded", "dusk", "lab_circle", "long_haul"),
    *("meadow", "office", "ramp", "sandbox", "sill", "stop_and_go", "street", "turntable"),
    "warehouse",
)
LABELS = ("labels.flow=true", "labels.occlusion=true", "labels.segmentation=true")

DATASETS: dict[str, tuple[str, ...]] = {
    **{scene: (scene, *SMALL, *LABELS) for scene in SCENES},
    "bumped": ("brick_court", *SMALL, "--disturb=brick_bump,noise,mast_flex"),
    "worn": ("office", *SMALL, "--disturb=blur,slip,rolling_shutter,stereo_mismatch"),
    "handheld": ("office", *SMALL, "drive.carrier=handheld"),
    "full": ("brick_court", "--disturb=noise=0.5"),
    "grainy": ("office", "--disturb=noise"),
}
"""Name to scene and options; a word without a leading dash is a setting."""

ALTERNATIVES: dict[str, tuple[str, ...]] = {
    "default": (),
    "thesis": ("--estimator=thesis",),
    "corner_flow": ("--estimator=corner_flow",),
    "thesis_unrefined": ("--estimator=thesis", "refinement.mode=none"),
    "thesis_absolute": (
        *("--estimator=thesis", "motion.method=absolute", "motion.residual=distance"),
    ),
    "thesis_window": ("--estimator=thesis", "refinement.window=30"),
    "thesis_left": ("--estimator=thesis", "refinement.use_disparity=false"),
    "thesis_two_views": ("--estimator=thesis", "refinement.min_views=2"),
    "thesis_threshold": ("--estimator=thesis", "motion.threshold=0.0015"),
    "thesis_drop": (
        *(
            "--estimator=thesis",
            "refinement.max_iterations=60",
            "refinement.max_keyframe_iterations=20",
        ),
    ),
    "harris": ("features.detector=harris",),
    "box": ("features.kernel=box",),
    "star": ("features.kernel=star",),
    "block_matching": ("stereo.method=block_matching",),
    "semi_global": ("stereo.method=semi_global", "stereo.refine=false"),
    "split": ("motion.method=decoupled",),
    "prior": ("motion.landmark_prior=true",),
    "by_refinement": ("motion.method=graduated_nonconvexity",),
    "preemptive": ("motion.scheme=preemptive", "motion.solver=fischler_bolles"),
    "triplets": ("matching.circular_check=true",),
    "unguided": ("matching.guided=false", "matching.align=false"),
    "motion_only": ("refinement.mode=motion",),
    "fixed_lag": ("refinement.mode=fixed_lag",),
    "smooth_global": ("refinement.smooth=global",),
    "firewall": ("refinement.map_reset_keyframes=6",),
    "one_noise": ("refinement.learn_noise=false",),
    "unaware": ("stationary=none",),
}

RENAMED_DISTURBANCES = {"stereo_offset": "eye_offset", "stereo_mismatch": "eye_mismatch"}
"""Today's name of a disturbance to the one that it had in an older checkout (--old-names)."""

RENAMED: dict[str, str] = {
    "stationary": "standing",
    "matching.circular_check": "matching.triplets",
    "motion.landmark_prior": "motion.prior",
    "motion.method=decoupled": "motion.method=split",
    "motion.method=graduated_nonconvexity": "motion.method=refinement",
    "refinement.map_reset_keyframes": "refinement.firewall_keyframes",
    "refinement.max_iterations": "refinement.most_iterations",
    "refinement.max_keyframe_iterations": "refinement.drop_iterations",
    "refinement.min_views": "refinement.least_views",
}
"""Today's key of a setting, or key=value, to that of an older checkout (--old-names)."""


@dataclass(frozen=True)
class Checkout:
    """A revision of the project, called through its command line.

    Attributes:
        root: Folder of the checkout.
        old_names: Whether it knows the older names of settings.
    """

    root: Path
    old_names: bool

    def driftyard(self, *words: str, log: Path, statuses: tuple[int, ...] = (0,)) -> None:
        """Call the command; what it prints goes to a file."""
        with (self.root / "pyproject.toml").open("rb") as file:
            module, function = tomllib.load(file)["project"]["scripts"]["driftyard"].split(":")
        code = (
            f"import sys; sys.argv[0] = 'driftyard'; from {module} import {function}; {function}()"
        )
        environment = {**os.environ, "PYTHONPATH": str(self.root), "OMP_NUM_THREADS": "1"}
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("w", encoding="utf-8") as file:
            done = subprocess.run(
                [sys.executable, "-c", code, *words],
                cwd=self.root, env=environment, stdout=file, stderr=subprocess.STDOUT, check=False,
            )  # fmt: skip
        if done.returncode not in statuses:
            text = log.read_text("utf-8")[-2000:]
            raise SystemExit(f"driftyard {' '.join(words)}: status {done.returncode}\n{text}")

    @property
    def camera(self) -> list[str]:
        """The option for the ideal camera, which a checkout of older names has by default."""
        return [] if self.old_names else ["--camera", "ideal"]

    def option(self, word: str) -> list[str]:
        """Write a word of a case as the command line takes it."""
        if word.startswith("--"):
            for name, old in RENAMED_DISTURBANCES.items() if self.old_names else ():
                word = word.replace(name, old)
            return [word]
        key, _, value = word.partition("=")
        old = RENAMED.get(word, f"{RENAMED.get(key, key)}={value}")
        return ["--set", old if self.old_names else word]

    def options(self, words: tuple[str, ...]) -> list[str]:
        """Write the words of a case as the command line takes them."""
        return [part for word in words for part in self.option(word)]


def make(checkout: Checkout, out: Path) -> None:
    """Compute everything into a folder, and its fingerprints into fingerprints.json there."""
    out.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(2) as pool:
        made = [pool.submit(generate, checkout, out, name) for name in DATASETS]
        for job in made:
            job.result()
        jobs = [pool.submit(run, checkout, out, name, "default") for name in DATASETS]
        jobs += [
            pool.submit(run, checkout, out, name, alternative)
            for name in ("full", "grainy")
            for alternative in ALTERNATIVES
        ]
        kitti = HERE.parent / "shared/data/kitti_06"
        if kitti.is_dir():
            link = out / "data/kitti_06"
            link.unlink(missing_ok=True)
            link.symlink_to(kitti)
            names = ("default", "thesis", "corner_flow")
            jobs += [pool.submit(run, checkout, out, "kitti_06", name) for name in names]
        for job in jobs:
            job.result()
        for job in [pool.submit(study, checkout, out) for study in (gate, explain, drive)]:
            job.result()
    found = fingerprints(out)
    (out / "fingerprints.json").write_text(json.dumps(found, indent=1) + "\n", "utf-8")
    print(f"{out}/fingerprints.json: {len(found)} files")


def generate(checkout: Checkout, out: Path, name: str) -> None:
    """Record a dataset of 1.5 m."""
    folder = out / "data" / name
    if folder.exists():
        return
    scene, *words = DATASETS[name]
    checkout.driftyard(
        "generate", scene, "--seed", SEED, "--out", str(folder), *checkout.camera,
        *checkout.options(("drive.distance_m=1.5", *words)), log=out / "log" / f"data-{name}.txt",
    )  # fmt: skip


def run(checkout: Checkout, out: Path, name: str, alternative: str) -> None:
    """Run an estimator over a dataset."""
    file = out / "runs" / name / f"{alternative}.txt"
    if file.exists():
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    checkout.driftyard(
        "run", str(out / "data" / name), "--out", str(file),
        *checkout.options(ALTERNATIVES[alternative]),
        log=out / "log" / f"run-{name}-{alternative}.txt",
    )  # fmt: skip


def gate(checkout: Checkout, out: Path) -> None:
    """Make a baseline with the thesis preset and hold the default settings against it."""
    baseline, verdict = out / "studies/baseline.json", out / "studies/gate.json"
    if verdict.exists():
        return
    baseline.parent.mkdir(parents=True, exist_ok=True)
    common = ("--baseline", str(baseline), "--cache", str(out / "cache/gate"))
    size = ("--record", SMALL[0], "--record", SMALL[1])
    bless = ("gate", "--bless") if checkout.old_names else ("gate", "update")
    checkout.driftyard(
        *bless, *common, "--scenes", "office,brick_court", "--seeds", "2", "--distance", "1.5",
        "--time-margin", "0", *size, *checkout.camera, log=out / "log/gate-baseline.txt",
    )  # fmt: skip
    check = ("gate",) if checkout.old_names else ("gate", "check")
    checkout.driftyard(
        *check, *common, "--estimator", "thesis", "--json", str(verdict),
        log=out / "log/gate.txt", statuses=(0, 1, 3),
    )  # fmt: skip


def explain(checkout: Checkout, out: Path) -> None:
    """Explain the drift over one dataset."""
    folder = out / "studies/explain"
    if folder.exists():
        return
    checkout.driftyard(
        "explain", str(out / "data/full"), "--out", str(folder), log=out / "log/explain.txt"
    )


def drive(checkout: Checkout, out: Path) -> None:
    """Drive to one goal by each source of localization."""
    file = out / "studies/drive.jsonl"
    if file.exists():
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    checkout.driftyard(
        "drive",
        "office",
        "--worlds",
        "1",
        "--out",
        str(file),
        *checkout.camera,
        log=out / "log/drive.txt",
    )


def fingerprints(out: Path) -> dict[str, str]:
    """SHA-256 of each file that a number is in."""
    found = {}
    for path in sorted((out / "data").rglob("*")):
        if (
            path.is_file()
            and path.name != "dataset.json"
            and (out / "data/kitti_06") not in path.parents
        ):
            found[str(path.relative_to(out))] = digest(path.read_bytes())
    for path in sorted((out / "runs").rglob("*")):
        name = str(path.relative_to(out))
        if path.name.endswith(".npz"):
            found[name] = digest(b"".join(x.tobytes() for x in arrays(path).values()))
        elif path.name.endswith(".frames.csv"):
            rows = path.read_text("utf-8").splitlines()[1:]
            found[name] = digest("\n".join(",".join(row.split(",")[:2]) for row in rows).encode())
        elif path.suffix in (".txt", ".ply"):
            found[name] = digest(path.read_bytes())
    for path in sorted((out / "studies").rglob("*")):
        if path.suffix in (".json", ".jsonl"):
            text = json.dumps(numbers(load(path)))
            found[str(path.relative_to(out))] = digest(text.encode())
    return found


def arrays(path: Path) -> dict[str, np.ndarray]:
    """Arrays of an archive, by name."""
    with np.load(path) as archive:
        return {name: archive[name] for name in sorted(archive.files)}


def load(path: Path) -> object:
    """Content of a JSON file, or of one with a value on each line."""
    text = path.read_text("utf-8")
    return (
        [json.loads(x) for x in text.splitlines()] if path.suffix == ".jsonl" else json.loads(text)
    )


def numbers(value: object) -> list[float]:
    """All numbers of a JSON value but times and settings, by size: keys may be renamed."""
    found: list[float] = []

    def visit(value: object, key: str) -> None:
        if isinstance(value, dict):
            for name, item in value.items():
                if name != "settings":
                    visit(item, name)
        elif isinstance(value, list):
            for item in value:
                visit(item, key)
        elif isinstance(value, float) and not {"time", "ms"} & set(key.split("_")):
            found.append(value)

    visit(value, "")
    return sorted(found)


def digest(data: bytes) -> str:
    """SHA-256, shortened."""
    return hashlib.sha256(data).hexdigest()[:16]


def compare(before: Path, after: Path) -> int:
    """Print each file that differs, and how far a trajectory moved; 1 if any does."""
    old, new = fingerprints(before), fingerprints(after)
    different = [name for name in old | new if old.get(name) != new.get(name)]
    for name in sorted(different):
        state = "differs" if name in old and name in new else "only in one"
        print(f"{name}: {state}{moved(before / name, after / name)}")
    print(f"{len(old)} and {len(new)} fingerprints, {len(different)} differ")
    return 1 if different else 0


def moved(before: Path, after: Path) -> str:
    """Largest difference between the positions of two trajectories, where these are given."""
    if before.suffix != ".txt" or not (before.is_file() and after.is_file()):
        return ""
    one, other = np.loadtxt(before, ndmin=2), np.loadtxt(after, ndmin=2)
    if one.shape != other.shape or not one.size:
        return f": {len(one)} and {len(other)} poses"
    return f": by at most {np.abs(one[:, 1:4] - other[:, 1:4]).max():.3g} m"


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="compute everything into a folder")
    making.add_argument("out", type=Path)
    making.add_argument("--checkout", type=Path, default=HERE, help="revision to call (this one)")
    making.add_argument("--old-names", action="store_true", help="it is older than the new names")
    making.add_argument("--data", type=Path, help="folder made before, whose datasets are used")
    comparing = commands.add_parser("compare", help="print what differs between two folders")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.command == "compare":
        return compare(given.before, given.after)
    if given.data:
        shutil.copytree(given.data / "data", given.out / "data", symlinks=True)
    make(Checkout(given.checkout.resolve(), given.old_names), given.out.resolve())
    return 0


if __name__ == "__main__":
    sys.exit(main())
