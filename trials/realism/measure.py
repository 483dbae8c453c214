"""Measurement of a recording without truth: one pass over its images, and a run of the estimator.

Grey levels stand for linear light as sRGB encodes it, unless a linear response is known.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from sim.imaging.linear_light import Response, levels_to_light
from trials.estimators.choice import Named, estimate
from trials.evaluation.runs import SavedRun, read_run
from trials.realism.landmarks import (
    Patches,
    coverage,
    cut_patches,
    histogram,
    patch_statistics,
    per_frame,
    run_statistics,
)
from trials.realism.noise import GREY, Blocks, measure_blocks, select_flat
from trials.realism.quantities import NOISE_GREY, TILE_PX, Measured, Statistic
from trials.realism.sharpness import edge_widths
from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image
from vo.contract.sequence import StereoSequence
from vo.features.detector import detect
from vo.recordings.pairing import FrameSelection
from vo.recordings.readers import open_sequence

ESTIMATOR = Named("driftyard", None, ("matching.search=features",))
"""Estimator of all measurements: it detects and matches features in every frame."""
ALL_FEATURES = FeatureSettings(count=100_000)
EDGE_FRAMES = 60
"""Largest number of frames in which edges are measured."""
PICTURES = 3


def measure(
    folder: Path,
    frames: int,
    response: Response = "srgb",
    progress: Callable[[int, int], None] | None = None,
) -> Measured:
    """Measure the first frames of a recording.

    Progress is called with the number of frames done, and that of all passes.

    Raises:
        DriftyardError: If the recording is unreadable.
    """
    total = len(open_sequence(folder))
    selection = FrameSelection(last=min(frames, total) - 1)
    sequence, count = open_sequence(folder, selection), min(frames, total)
    done = 0

    def advance(_: object) -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done, 2 * count)

    with tempfile.TemporaryDirectory(prefix="driftyard-") as scratch:
        out = Path(scratch) / "run.txt"
        estimate(ESTIMATOR, folder, out, advance, selection)
        run = read_run(out)
    return _measure_images(sequence, run, partial(_light, response), advance)


@dataclass(frozen=True)
class _Frame:
    """What one frame contributes."""

    grey: Array
    gradient: Array
    power: Array
    features: int
    blocks: Blocks
    edge_widths: Array
    patches: Patches
    coverage: float


def _measure_images(
    sequence: StereoSequence,
    run: SavedRun,
    decode: Callable[[Image], Array],
    advance: Callable[[object], None],
) -> Measured:
    count = len(sequence)
    with_edges = set(np.linspace(0, count - 1, min(EDGE_FRAMES, count)).astype(int).tolist())
    with_picture = np.linspace(0, count - 1, min(PICTURES, count)).astype(int).tolist()
    frames: list[_Frame] = []
    pictures: list[Image] = []
    tracks = run.tracks
    assert tracks is not None  # our own runs always write them
    for i, frame in enumerate(sequence):
        left = frame.left
        frames.append(
            _Frame(
                np.bincount(left.ravel(), minlength=256).astype(np.float64),
                _gradients(left),
                power_spectrum(left),
                len(detect(left, ALL_FEATURES)),
                measure_blocks(left),
                edge_widths(left, decode(left)) if i in with_edges else np.zeros(0),
                cut_patches((left, frame.right), tracks, i, decode),
                coverage(tracks.pixels[tracks.frame == i], sequence.rig),
            )
        )
        if i in with_picture:
            pictures.append(left)
        advance(i)
    found = {
        "grey": Statistic(np.array([x.grey for x in frames])),
        "gradient": Statistic(np.array([x.gradient for x in frames])),
        **_noise([x.blocks for x in frames]),
        "edge_width": _histogram("edge_width", [x.edge_widths for x in frames]),
        "features": per_frame(np.array([x.features for x in frames])),
        "coverage": per_frame(np.array([x.coverage for x in frames])),
        **patch_statistics([x.patches for x in frames], sequence.rig),
        **run_statistics(run, count),
    }
    if len(frames[0].power):
        power = np.array([x.power for x in frames])
        found["power"] = Statistic(power, np.ones((count, 1)))
    return Measured(sequence.name, count, found, tuple(pictures))


def power_spectrum(image: Image) -> Array:
    """Return the radial power spectrum of an image (H, W): mean over tiles, grey levels squared.

    White noise of variance s² has s² at all frequencies, which are those of the quantity `power`.
    Empty for an image that is smaller than a tile.
    """
    rows, columns = image.shape[0] // TILE_PX, image.shape[1] // TILE_PX
    if not rows * columns:
        return np.zeros(0)
    tiles = image[: rows * TILE_PX, : columns * TILE_PX].astype(np.float32)
    tiles = tiles.reshape(rows, TILE_PX, columns, TILE_PX).swapaxes(1, 2)
    window = np.outer(*(np.hanning(TILE_PX + 1)[:-1],) * 2)
    centred = tiles - (tiles * window).sum(axis=(2, 3), keepdims=True) / window.sum()
    energy = abs(np.fft.fft2(centred * window)) ** 2 / (window**2).sum()
    at = np.fft.fftfreq(TILE_PX) * TILE_PX
    ring = np.round(np.hypot(at, at[:, None])).astype(int)
    half = TILE_PX // 2
    mean = energy.mean(axis=(0, 1))
    return np.array([mean[ring == k].mean() for k in range(1, half + 1)])


def _light(response: Response, image: Image) -> Array:
    table = levels_to_light(response, np.arange(256)).astype(np.float32)
    return np.asarray(cv2.LUT(image, table))


def _gradients(image: Image) -> Array:
    values = image.astype(np.float32)
    du = (values[1:-1, 2:] - values[1:-1, :-2]) / 2
    dv = (values[2:, 1:-1] - values[:-2, 1:-1]) / 2
    size = np.hypot(du, dv).ravel()
    return histogram("gradient", size, np.zeros(len(size), np.int64), 1).parts[0]


def _histogram(name: str, values: list[Array]) -> Statistic:
    frame = np.repeat(np.arange(len(values)), [len(x) for x in values])
    return histogram(name, np.concatenate(values), frame, len(values))


def _noise(frames: list[Blocks]) -> dict[str, Statistic]:
    """Sum energy and mean of the flat blocks of all frames by their bins of grey levels."""
    parts = (np.concatenate([getattr(x, k) for x in frames]) for k in ("mean", "low", "high"))
    blocks = Blocks(*parts)
    bins, flat = select_flat(blocks)
    frame = np.repeat(np.arange(len(frames)), [len(x.mean) for x in frames])
    place = (frame * len(GREY) + bins)[flat]
    energy, grey, counts = (
        np.bincount(place, x[flat], len(frames) * len(GREY)).reshape(len(frames), len(GREY))
        for x in (blocks.high, blocks.mean, np.ones(len(bins)))
    )
    return {"noise": Statistic(energy, counts), NOISE_GREY: Statistic(grey, counts)}
