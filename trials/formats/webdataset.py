"""WebDataset: tar files of samples, each of which is a run of files of one name.

Source: the page on WebDataset's format, github.com/webdataset/webdataset.
"""

import io
import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np

from sim.dataset.image_codecs import encode_png
from sim.labels.formats import CODES, LABELS
from trials.formats.folder import Advance
from trials.formats.recording import Recording
from vo.contract.arrays import Array

SHARD_BYTES = 512 * 2**20
"""Size from which on a shard is followed by the next."""


def write_webdataset(recording: Recording, out: Path, advance: Advance) -> None:
    """Write shards NAME-000000.tar of samples NAME_000000: left.png, right.png, labels and json."""
    out.mkdir(parents=True, exist_ok=True)
    i, shards = 0, 0
    while i < len(recording):
        with tarfile.open(out / f"{recording.name}-{shards:06d}.tar", "w") as shard:
            while i < len(recording) and shard.offset < SHARD_BYTES:
                for suffix, data in sample(recording, i).items():
                    # A name ends at its first dot.
                    add_file(shard, f"{recording.name.replace('.', '_')}_{i:06d}.{suffix}", data)
                advance(i)
                i += 1
        shards += 1


def sample(recording: Recording, i: int) -> dict[str, bytes]:
    """Return the files of frame i by suffix: images, labels that exist, and metadata."""
    left, right = recording.eyes(i)
    files = {"left.png": left, "right.png": right}
    for name, form in LABELS.items():
        values = recording.label(name, i)
        if values is not None and form.encoding == CODES:
            files[f"{name}.png"] = encode_png(values)
        elif values is not None:
            files[f"{name}.npy"] = _npy(values)
    files["json"] = json.dumps(metadata(recording, i)).encode()
    return files


def metadata(recording: Recording, i: int) -> dict[str, Any]:
    """Return time, calibration and true pose of frame i, JSON-ready."""
    rig, pose = recording.rig, recording.pose(i)
    return {
        "dataset": recording.name,
        "frame": i,
        "timestamp_ns": recording.times_ns[i],
        "K": rig.K.tolist(),
        "baseline_m": rig.baseline_m,
        "T_body_cam": rig.T_body_cam.tolist(),
        "T_world_cam": None if pose is None else pose.tolist(),
    }


def _npy(values: Array) -> bytes:
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(values))
    return file.getvalue()


def add_file(shard: tarfile.TarFile, name: str, data: bytes) -> None:
    """Add a file without owner and time, so that equal content gives equal bytes."""
    entry = tarfile.TarInfo(name)
    entry.size = len(data)
    shard.addfile(entry, io.BytesIO(data))
