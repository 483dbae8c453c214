"""Speed of recording, by one worker and by one per core."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from sim.batch import build
from sim.record import record
from trials.execution.progress import ProgressBar, no_progress
from trials.studies.speed.drive import NOISE, TimedDrive, on_cores, peak_memory_mb
from vo.contract.dataset import read_manifest


@dataclass(frozen=True)
class GeneratorSpeed:
    """Speed of the generator.

    Attributes:
        frames: Number of recorded frames.
        frame_ms: Mean from the first finished frame to the last: rendered, noise added, encoded,
            hashed, certified and written, two images with depth and disparity.
        whole_s: Wall time with scene, drive and map.
        memory_mb: Largest resident size of the process.
        gl: Name of the GL's renderer.
    """

    frames: int
    frame_ms: float
    whole_s: float
    memory_mb: float
    gl: str


def measure_generator(
    drive: TimedDrive, out: Path, bar: ProgressBar = no_progress
) -> GeneratorSpeed:
    """Record the dataset `out` with sensor noise, and time it."""
    settings = drive.settings(*NOISE)
    finished_s: list[float] = []
    start = perf_counter()
    with bar("generating") as progress:

        def advance(done: int, total: int) -> None:
            finished_s.append(perf_counter())
            progress(done, total)

        record(build(drive.scene, settings), settings, out, progress=advance)
    whole_s = perf_counter() - start
    frame_ms = 1e3 * (finished_s[-1] - finished_s[0]) / (len(finished_s) - 1)
    gl = read_manifest(out)["software"]["gl"]["renderer"]
    return GeneratorSpeed(len(finished_s), frame_ms, whole_s, peak_memory_mb(), gl)


def measure_scaling(drive: TimedDrive, cores: list[int], folder: Path) -> float:
    """Return the frame rate of one generator per core over that of one, each on its own core."""
    alone = on_cores(cores[:1], measure_generator, drive, folder / "alone")
    with ThreadPoolExecutor(len(cores)) as pool:  # each thread has its own affinity
        jobs = [
            pool.submit(on_cores, [core], measure_generator, drive, folder / f"core_{core}")
            for core in cores
        ]
        together = [job.result() for job in jobs]
    return sum(alone.frame_ms / each.frame_ms for each in together)
