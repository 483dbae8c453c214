"""`driftyard label`: truth of a dataset beyond its recorded labels."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import driftyard as dy
from sim.dataset.image_codecs import encode_float, encode_png
from trials.cli import console
from trials.cli.options import Dataset, FrameOptions, option
from trials.formats.folder import Advance, new_folder, put
from trials.report.truth_pictures import (
    boxes_picture,
    cloud_picture,
    flow_picture,
    occupancy_picture,
    tracks_picture,
)
from vo.contract.errors import SettingsError

PICTURES = 4
"""Largest number of frames of which there are pictures."""


@dataclass(frozen=True)
class LabelOptions:
    """What is computed, and how densely."""

    what: str = option(
        "flow,tracks,boxes,cloud,occupancy", "What to write.", metavar="KIND[,KIND...]"
    )
    apart: int = option(1, "Frames from the first to the second of each flow; < 0: backwards.")
    grid: int = option(16, "Distance of the tracked points in the first image, px.", min=1)
    voxel: float = option(0.02, "Side of the cubes in which points are one, m.", min=0.001)
    resolution: float = option(0.05, "Side of the cells of occupancy, m.", min=0.001)
    pictures: bool = option(False, "Draw pictures of a few frames.", "--pictures")


@dataclass(frozen=True)
class _Job:
    """Chosen frames of a dataset, options, the folder to write, and what advances the bar."""

    ds: dy.Dataset
    options: LabelOptions
    folder: Path
    advance: Advance

    def is_drawn(self, i: int) -> bool:
        few = np.linspace(0, len(self.ds) - 1, PICTURES).astype(int)
        return self.options.pictures and i in few

    def draw(self, name: str, figure: Figure) -> None:
        place = self.folder / "pictures"
        place.mkdir(parents=True, exist_ok=True)
        figure.savefig(place / f"{name}.png", facecolor="white")


def label(
    dataset: Dataset,
    frames: FrameOptions,
    options: LabelOptions,
    out: Path = option(..., "Folder to write; it must not exist.", metavar="FOLDER"),
) -> None:
    """Write truth beyond the recorded labels, from geometry: a dataset of driftyard is replayed.

    flow: between frames that are --apart; tracks: points of the first frame through all; boxes:
    of each object, in image and world; cloud: fused from depth; occupancy: of ground and voxels.
    """
    kinds = [word.strip() for word in options.what.split(",") if word.strip()]
    unknown = [x for x in kinds if x not in WRITERS]
    if unknown or not kinds:
        valid = ", ".join(WRITERS)
        raise SettingsError(f"--what: unknown {', '.join(unknown) or 'nothing'}; valid: {valid}")
    ds = frames.open(dataset)
    total = len(ds) * len({"flow", "boxes"}.intersection(kinds))
    with new_folder(out) as folder, console.counting_bar("labelling", total) as advance:
        job = _Job(ds, options, folder, advance)
        for kind in kinds:
            WRITERS[kind](job)
    console.out.print(f"{out}: {', '.join(kinds)} of {len(ds)} frames", markup=False)


def _write_flow(job: _Job) -> None:
    ds, apart = job.ds, job.options.apart
    pairs = [(i, i + apart) for i in range(len(ds)) if 0 <= i + apart < len(ds)]
    if not pairs:
        raise SettingsError(f"--apart {apart}: there are {len(ds)} frames")
    with ds.views.opened(not all(ds.views.are_static(i) for i, _ in pairs)):
        for i, j in pairs:
            motion = dy.flow(ds, i, j)
            name = f"{i:06d}_{j:06d}"
            label = np.dstack([motion.flow, motion.depth_m])
            put(job.folder / f"flow/{name}.tiff", encode_float(label))
            put(job.folder / f"covisibility/{name}.png", encode_png(motion.covisibility))
            if job.is_drawn(i):
                about = motion.flow, motion.covisibility, ds[i].left, f"frame {j}"
                job.draw(f"flow_{name}", flow_picture(*about))
            job.advance(i)


def _write_tracks(job: _Job) -> None:
    ds = job.ds
    tracks = dy.tracks(ds, job.options.grid)
    tracks.save(job.folder / "tracks.npz")
    if job.options.pictures:
        frames = sorted({0, len(ds) // 2, len(ds) - 1})
        job.draw("tracks", tracks_picture(tracks, [ds[i].left for i in frames], frames))


def _write_boxes(job: _Job) -> None:
    ds, found = job.ds, list[object]()
    with ds.views.opened(replayed=True):
        for i, time_ns in enumerate(ds.timestamps_ns.tolist()):
            boxes = dy.boxes(ds, i)
            found.append({"timestamp_ns": time_ns, "boxes": [x.to_dict() for x in boxes]})
            if job.is_drawn(i):
                job.draw(f"boxes_{i:06d}", boxes_picture(boxes, ds[i].left, ds.views.rig))
            job.advance(i)
    put(job.folder / "boxes.json", json.dumps({"frames": found}, indent=1) + "\n")


def _write_cloud(job: _Job) -> None:
    cloud = dy.point_cloud(job.ds, voxel_m=job.options.voxel)
    cloud.save(job.folder / "cloud.ply")
    if job.options.pictures:
        job.draw("cloud", cloud_picture(cloud, job.ds.T_world_cam))


def _write_occupancy(job: _Job) -> None:
    ds, side_m = job.ds, job.options.resolution
    ground, voxels = dy.occupancy(ds, side_m), dy.occupancy(ds, side_m, dimensions=3)
    ground.save(job.folder / "ground.yaml")
    ground.save(job.folder / "ground.npz")
    voxels.save(job.folder / "voxels.npz")
    if job.options.pictures:
        job.draw("occupancy", occupancy_picture(ground, voxels, ds.T_world_cam))


WRITERS: dict[str, Callable[[_Job], None]] = {
    "flow": _write_flow,
    "tracks": _write_tracks,
    "boxes": _write_boxes,
    "cloud": _write_cloud,
    "occupancy": _write_occupancy,
}
"""Kinds of truth by name, and what writes them."""
