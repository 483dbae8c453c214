"""The card of a Hugging Face dataset: front matter, contents, figures, results and licence."""

import json
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from typing import Any

import numpy as np
import yaml

from trials.evaluation.runs import read_run
from trials.evaluation.score import Score, score_run
from trials.evaluation.truth import true_trajectory
from trials.formats.recording import Recording
from vo.contract.dataset import MANIFEST
from vo.contract.errors import DriftyardError
from vo.recordings.readers import read_frame_times

SIZES = {1_000: "n<1K", 10_000: "1K<n<10K", 100_000: "10K<n<100K", 1_000_000: "100K<n<1M"}
"""Numbers of samples below which the Hub has a category, and its name."""

FIELDS = """\
| column | content |
|---|---|
| `left`, `right` | rectified images; pixel centres on integers |
| `depth` | distance along the optical axis of the left pixels, m, 32-bit float, NaN where unknown |
| `disparity`, `disparity_right` | `u_left - u_right` > 0, px, 32-bit float, NaN where unknown |
| `occlusion` | visibility in the right image: 0 visible, 1 occluded, 2 outside, 3 no surface, \
4 edge |
| `segmentation`, `classes` | object by its number; 0 sky, 1 ground, 2 static, 3 moving |
| `timestamp_ns` | middle of the exposure, ns |
| `K`, `baseline_m` | pinhole matrix of both cameras, px; distance of the right camera along x, m |
| `T_world_cam` | true pose of the left camera, 4 x 4: `p_world = T_world_cam @ p_cam`; x right, \
y down, z forward; the world is in metres, z up |
| `T_body_cam` | left camera in the body: x forward, y left, z up |

A column is there if all recordings have it. Flow, covisibility and normals are not in this format.
"""


def card(splits: Mapping[str, Sequence[Recording]], figures: Sequence[str]) -> str:
    """Return README.md of recordings by split, with the paths of their figures."""
    recordings = [x for members in splits.values() for x in members]
    licence = "mit" if all(map(_is_of_driftyard, recordings)) else "unknown"
    pictures = "\n\n".join(f"![left, right, disparity]({x})" for x in figures)
    rows = [row for name, members in splits.items() for x in members for row in _row(name, x)]
    parts = (
        f"---\n{yaml.safe_dump(_front_matter(splits, licence), sort_keys=False)}---",
        f"# {', '.join(x.name for x in recordings[:3])}{' and others' if recordings[3:] else ''}",
        "Rectified stereo sequences for visual odometry, with true poses and labels, exported by "
        "driftyard.",
        pictures,
        "## Recordings\n\nSplits are of whole recordings.\n\n"
        + _table(("split", "recording", "scene", "seed", "frames", "path, m", "pixels"), rows),
        f"## Columns\n\n{FIELDS}",
        f"## Results\n\n{_results(recordings)}",
        f"## Licence\n\n{_licence_text(licence)}",
    )
    return "\n\n".join(x.strip("\n") for x in parts) + "\n"


def _front_matter(splits: Mapping[str, Sequence[Recording]], licence: str) -> dict[str, Any]:
    frames = sum(len(x) for members in splits.values() for x in members)
    size = next((name for most, name in SIZES.items() if frames < most), "n>1M")
    files = [{"split": x, "path": f"{x}/**"} for x in splits]
    return {
        "license": licence,
        "task_categories": ["depth-estimation"],
        "tags": ["visual-odometry", "stereo", "slam", "driftyard"],
        "size_categories": [size],
        "configs": [{"config_name": "default", "data_files": files}],
    }


def _is_of_driftyard(recording: Recording) -> bool:
    """Whether it was recorded in one of driftyard's scenes, which are made by its code alone."""
    scene = (recording.manifest or {}).get("scene", {})
    return bool(scene) and scene.get("source") == scene.get("name")


def _licence_text(licence: str) -> str:
    if licence == "mit":
        return "The scenes are made by driftyard's code alone, which is under the MIT licence."
    return (
        "Some recordings or scenes are of other origin; their licences apply. State them here and "
        "under `license` before publication."
    )


def _row(split: str, recording: Recording) -> Iterator[tuple[str, ...]]:
    manifest, rig = recording.manifest or {}, recording.rig
    steps = np.linalg.norm(np.diff(recording.poses[:, :3, 3], axis=0), axis=1)
    length = "–" if np.isnan(steps).all() else f"{np.nansum(steps):.2f}"
    scene, seed = manifest.get("scene", {}).get("name", "–"), str(manifest.get("seed", "–"))
    size = f"{rig.width_px} x {rig.height_px}"
    yield split, recording.name, scene, seed, str(len(recording)), length, size


def _results(recordings: Sequence[Recording]) -> str:
    """Tabulate the scores of the runs that lie beside the datasets."""
    scores = [(x, score) for x in recordings for score in _scores(x)]
    if not scores:
        return "No runs of estimators lay beside the datasets when they were exported."
    rows = [
        (
            recording.name,
            score.estimator,
            f"{score.drift_1m.mean_percent:.3f}" if score.drift_1m else "–",
            f"{errors.rmse:.4f}" if (errors := score.ate_m.get("se3")) else "–",
            str(score.statuses.get("lost", "–")),
        )
        for recording, score in scores
    ]
    header = "recording", "estimator", "drift over 1 m, %", "ATE after SE(3), m", "lost frames"
    return _table(header, rows)


def _scores(recording: Recording) -> Iterator[Score]:
    """Score the runs beside a dataset whose record names its manifest, except unreadable ones."""
    if recording.manifest is None:
        return
    digest = sha256((recording.folder / MANIFEST).read_bytes()).hexdigest()
    truth, times = true_trajectory(recording.folder), read_frame_times(recording.folder)
    for record in sorted(recording.folder.resolve().parent.glob("*.run.json")):
        try:
            if json.loads(record.read_text("utf-8")).get("dataset_sha256") == digest:
                file = record.with_name(record.name.removesuffix(".run.json") + ".txt")
                yield score_run(truth, read_run(file, times), len(times))
        except (DriftyardError, OSError, ValueError, AttributeError):
            continue


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = (header, ["---"] * len(header), *rows)
    return "\n".join(f"| {' | '.join(x)} |" for x in lines)
