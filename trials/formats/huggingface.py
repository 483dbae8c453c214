"""Hugging Face dataset: image folders with metadata, and a card.

Source: the pages "Image Dataset" and "Dataset Cards" of the Hugging Face Hub's documentation.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from sim.labels.formats import FLOAT_3, FORWARD, LABELS, label_file
from trials.formats.dataset_card import card
from trials.formats.folder import Advance, put
from trials.formats.recording import Recording
from trials.formats.webdataset import metadata
from vo.contract.arrays import Array
from vo.contract.dataset import MANIFEST

IMAGES = {
    name: form for name, form in LABELS.items() if form.encoding != FLOAT_3 and name not in FORWARD
}
"""Labels of one channel, which Pillow opens, of one frame."""
TEST_SHARE = 5
"""Of so many recordings, one is for tests."""


def write_huggingface(recordings: Sequence[Recording], out: Path, advance: Advance) -> None:
    """Write README.md, train and test with metadata.jsonl, figures, and each dataset.json."""
    splits, are_own = split(recordings), all(x.manifest is not None for x in recordings)
    labels = [x for x in IMAGES if are_own and all(y.has(x) for y in recordings)]
    for name, members in splits.items():
        lines: list[str] = []
        for recording in members:
            for i in range(len(recording)):
                files = _write_frame(recording, i, labels, out / name)
                lines.append(json.dumps({**files, **metadata(recording, i)}) + "\n")
                advance(i)
        put(out / name / "metadata.jsonl", "".join(lines))
    for recording in recordings:
        put(out / figure_name(recording), _figure(recording))
        if recording.manifest is not None:
            manifest = (recording.folder / MANIFEST).read_bytes()
            put(out / f"recordings/{recording.name}.json", manifest)
    put(out / "README.md", card(splits, [figure_name(x) for x in recordings]))


def split(recordings: Sequence[Recording]) -> Mapping[str, Sequence[Recording]]:
    """Divide whole recordings: the last fifth, at least one of several, is for tests."""
    count = max(1, len(recordings) // TEST_SHARE) if len(recordings) > 1 else 0
    first = len(recordings) - count
    return {"train": recordings[:first]} | ({"test": recordings[first:]} if count else {})


def figure_name(recording: Recording) -> str:
    """Return the path of a recording's figure."""
    return f"figures/{recording.name}.png"


def _write_frame(recording: Recording, i: int, labels: Sequence[str], out: Path) -> dict[str, str]:
    """Write images and labels; returns their paths in `out` under the names of columns."""
    files: dict[str, str] = {}
    contents = dict(zip(("left", "right"), recording.eyes(i), strict=True))
    suffixes = dict.fromkeys(contents, ".png")
    for name in labels:
        recording.label(name, i)  # raises if it is damaged
        path = label_file(recording.folder, name, recording.times_ns[i])
        contents[name], suffixes[name] = path.read_bytes(), path.suffix
    for name, data in contents.items():
        path = f"{recording.name}/{name}/{i:06d}{suffixes[name]}"
        put(out / path, data)
        files[f"{name}_file_name"] = path
    return files


def _figure(recording: Recording) -> bytes:
    """Draw the pair in the middle of a recording, and its disparity if there is a label."""
    i = len(recording) // 2
    tiles = [_bgr(x) for x in recording.pixels(i)]
    if recording.has_depth:
        disparity = recording.disparity(i)
        scaled = np.nan_to_num(disparity / np.nanmax(disparity, initial=1.0)).clip(0, 1)
        tiles.append(cv2.applyColorMap((255 * scaled).astype(np.uint8), cv2.COLORMAP_TURBO))
    _, data = cv2.imencode(".png", np.hstack(tiles))
    return data.tobytes()


def _bgr(image: Array) -> Array:
    return np.dstack([image] * 3) if image.ndim == 2 else image[..., ::-1]
