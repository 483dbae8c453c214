"""Occupancy grids: cells of the ground or voxels that are occupied, free or unknown."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.dataset.image_codecs import encode_png
from sim.truth.voxels import FREE, OCCUPIED, UNKNOWN
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix, replacing, write_text

GREYS = {UNKNOWN: 205, FREE: 254, OCCUPIED: 0}
"""Grey levels of ROS' maps."""


@dataclass(frozen=True, repr=False, eq=False)
class Occupancy:
    """Occupancy of the static world; moving objects are left out.

    Attributes:
        states: (H, W) cells, rows along y, columns along x, or (D, H, W) voxels, layers along z;
            int8: 100 occupied, 0 free, -1 unknown, as in ROS.
        origin_m: (2,) or (3,) x, y, z in the world of the outer corner of the first cell.
        resolution_m: Side of a cell.

    Example:
        >>> ground = dy.occupancy("yard.xml", 0.1)
        >>> ground.at([[0.0, 0.0], [1.5, 1.5], [9.0, 9.0]]).tolist()  # pillar, floor, beyond
        [100, 0, -1]
        >>> voxels = dy.occupancy("yard.xml", 0.2, dimensions=3)
        >>> voxels.at([[0.0, 0.0, 0.3], [0.0, 0.0, 0.9]]).tolist()  # in the pillar, above it
        [100, 0]
    """

    states: Array
    origin_m: Array
    resolution_m: float

    def at(self, points: Array) -> Array:
        """Return the states (N,) at points (N, 2 or 3) of the world; unknown beyond the grid."""
        given = np.asarray(points, dtype=float)
        dimensions = self.states.ndim
        if given.ndim != 2 or given.shape[1] != dimensions:
            raise SettingsError(f"points: shape {given.shape}; expected (N, {dimensions})")
        cells = np.floor((given - self.origin_m) / self.resolution_m)[:, ::-1]
        inside = ((cells >= 0) & (cells < self.states.shape)).all(axis=1)
        found = np.full(len(given), UNKNOWN, np.int8)
        found[inside] = self.states[tuple(cells[inside].astype(np.int64).T)]
        return found

    def centres(self, state: int = OCCUPIED) -> Array:
        """Return the centres (N, 2 or 3) of the cells of a state in the world, metres."""
        cells = np.argwhere(self.states == state)[:, ::-1]
        return self.origin_m + (cells + 0.5) * self.resolution_m

    def save(self, path: Path | str) -> Path:
        """Write `.npz`, or of cells of the ground `.yaml` and `.pgm` for ROS; return its path.

        Raises:
            SettingsError: If the name has another suffix, or a map has three dimensions.
            DatasetError: If the file cannot be written.
        """
        out = Path(path)
        suffix = known_suffix(out, (".npz", ".yaml"))
        if suffix == ".yaml" and self.states.ndim == 3:
            raise SettingsError(f"{out}: a map for ROS has two dimensions; save voxels as .npz")
        if suffix == ".npz":
            with replacing(out) as partial, partial.open("wb") as file:
                np.savez_compressed(
                    file,
                    states=self.states,
                    origin_m=self.origin_m,
                    resolution_m=self.resolution_m,
                    frame="world",
                )
            return out
        image = out.with_suffix(".pgm")
        with replacing(image) as partial:
            height, width = self.states.shape
            partial.write_bytes(b"P5 %d %d 255\n" % (width, height) + self._greys().tobytes())
        x, y = self.origin_m.tolist()
        lines = f"image: {image.name}", "mode: trinary", f"resolution: {self.resolution_m!r}"
        rules = "negate: 0", "occupied_thresh: 0.65", "free_thresh: 0.196"
        write_text(out, "\n".join([*lines, f"origin: [{x!r}, {y!r}, 0.0]", *rules, ""]))
        return out

    def _greys(self) -> Array:
        """Return the grey levels (H, W) of ROS' maps, y up."""
        grey = np.full(self.states.shape, GREYS[UNKNOWN], np.uint8)
        for state in (FREE, OCCUPIED):
            grey[self.states == state] = GREYS[state]
        return grey[::-1]

    def _repr_png_(self) -> bytes | None:
        return encode_png(np.ascontiguousarray(self._greys())) if self.states.ndim == 2 else None

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.states.shape[::-1]))
        share = float(np.mean(self.states == OCCUPIED))
        return f"Occupancy({size} cells of {self.resolution_m:g} m, {share:.0%} occupied)"
