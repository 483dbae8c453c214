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
from trials.evaluation.runs import SavedRun, Tracks, read_run
from trials.realism.landmarks import (
    NO_PATCHES,
    Patches,
    coverage,
    cut_patches,
    histogram,
    landmarks_of,
    patch_statistics,
    per_frame,
    run_statistics,
    steps_of,
)
from trials.realism.noise import GREY, NO_BLOCKS, Blocks, measure_blocks, select_flat
from trials.realism.quantities import NOISE_GREY, TILE_PX, Measured, Statistic
from trials.realism.sharpness import edge_profiles, edge_widths, no_profiles
from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image
from vo.contract.errors import ImageError
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame, StereoSequence
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
    """Measure the first frames of a recording; those with unreadable images count nothing.

    Progress is called with the number of frames done, and that of all passes.

    Raises:
        DriftyardError: If the recording is unreadable, or no image is readable.
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
    features: float
    blocks: Blocks
    patches: Patches
    coverage: float


NOTHING = _Frame(np.zeros(256), np.zeros(256), np.zeros(0), np.nan, NO_BLOCKS, NO_PATCHES, np.nan)
"""What a frame with an unreadable image contributes."""


def _measure_images(
    sequence: StereoSequence,
    run: SavedRun,
    decode: Callable[[Image], Array],
    advance: Callable[[object], None],
) -> Measured:
    count = len(sequence)
    with_edges = set(np.linspace(0, count - 1, min(EDGE_FRAMES, count)).astype(int).tolist())
    with_picture = np.linspace(0, count - 1, min(PICTURES, count)).astype(int).tolist()
    frames, pictures = [NOTHING] * count, list[Image]()
    edges = [no_profiles()] * count
    tracks = run.tracks
    assert tracks is not None  # our own runs always write them
    for i in range(count):
        advance(i)
        try:
            frame = sequence[i]
        except ImageError:
            continue  # the run of the estimator has said so
        frames[i] = _measure_frame(frame, tracks, i, sequence.rig, decode)
        if i in with_edges:
            edges[i] = edge_profiles(frame.left, decode(frame.left))
        if i in with_picture:
            pictures.append(frame.left)
    found = {
        "grey": Statistic(np.array([x.grey for x in frames])),
        "gradient": Statistic(np.array([x.gradient for x in frames])),
        **_noise([x.blocks for x in frames]),
        "edge_width": _histogram("edge_width", edge_widths(edges)),
        "features": per_frame(np.array([x.features for x in frames])),
        "coverage": per_frame(np.array([x.coverage for x in frames])),
        **patch_statistics([x.patches for x in frames], sequence.rig),
        **run_statistics(run, count),
    }
    if size := max(len(x.power) for x in frames):
        known = np.array([[float(len(x.power) > 0)] for x in frames])
        power = np.array([x.power if len(x.power) else np.zeros(size) for x in frames])
        found["power"] = Statistic(power, known)
    geometry = landmarks_of(run), *steps_of(run), sequence.rig.baseline_m
    return Measured(sequence.name, count, found, tuple(pictures), *geometry)


def _measure_frame(
    frame: StereoFrame, tracks: Tracks, i: int, rig: StereoRig, decode: Callable[[Image], Array]
) -> _Frame:
    left = frame.left
    return _Frame(
        np.bincount(left.ravel(), minlength=256).astype(np.float64),
        gradients(left),
        power_spectrum(left),
        len(detect(left, ALL_FEATURES)),
        measure_blocks(left),
        cut_patches((left, frame.right), tracks, i, decode),
        coverage(tracks.pixels[tracks.frame == i], rig),
    )


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


def gradients(image: Image) -> Array:
    """Count the sizes of the gradients of an image (H, W) in the bins of the quantity."""
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
