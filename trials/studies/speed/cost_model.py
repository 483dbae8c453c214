"""A model of the cost of a frame by scene, labels, size and camera, fitted to what was measured."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from trials.studies.speed.costs import (
    BASE,
    CAMERAS,
    IMAGES,
    LABELS,
    LARGE_PX,
    Conditions,
    Cost,
)


@dataclass(frozen=True)
class Line:
    """Cost that consists of a fixed part and one for each megapixel, neither negative."""

    fixed: float
    per_mpx: float

    @staticmethod
    def fit(costs: Mapping[Conditions, float]) -> "Line":
        """Fit by least squares."""
        sizes = [[1.0, x.megapixels] for x in costs]
        found, _ = nnls(np.array(sizes), np.array([*costs.values()]))
        return Line(*found.tolist())

    def at(self, megapixels: float) -> float:
        """Cost of an image of this size."""
        return self.fixed + self.per_mpx * megapixels


@dataclass(frozen=True)
class Power:
    """Bytes that grow with a power of the size: large pictures of the same compress better."""

    per_mpx: float
    exponent: float

    @staticmethod
    def fit(costs: Mapping[Conditions, float]) -> "Power":
        """Fit the logarithms by least squares."""
        sizes, values = np.log([x.megapixels for x in costs]), np.log([*costs.values()])
        exponent, level = np.polyfit(sizes, values, 1)
        return Power(float(np.exp(level)), float(exponent))

    def at(self, megapixels: float) -> float:
        """Bytes of an image of this size."""
        return self.per_mpx * megapixels**self.exponent


@dataclass(frozen=True)
class SceneCosts:
    """Costs of a frame of a scene: milliseconds of images and of all labels, kilobytes by part.

    And the seconds of a drive beside its frames.
    """

    images: Line
    labels: Line
    kb: Mapping[str, Power]
    drive_s: float


@dataclass(frozen=True)
class CostModel:
    """Costs of a frame by scene, labels, size and camera.

    Attributes:
        scenes: What a scene costs.
        shares: Part of a label in the processor time of all labels; sums to more than 1, as labels
            share what is computed for them.
        cameras: Milliseconds beside those of images.
        image_kb: Ratio of the kilobytes of a camera's images to those of the base.
    """

    scenes: Mapping[str, SceneCosts]
    shares: Mapping[str, float]
    cameras: Mapping[str, Line]
    image_kb: Mapping[str, float]

    @staticmethod
    def fit(costs: Mapping[Conditions, Cost]) -> "CostModel":
        """Fit the rows of `design`."""

        def at(scene: str, labels: tuple[str, ...], camera: str = "") -> dict[Conditions, Cost]:
            return {
                x: cost
                for x, cost in costs.items()
                if (x.scene, x.labels, x.camera) == (scene, labels, camera)
            }

        def beside(rows: Mapping[Conditions, Cost]) -> dict[Conditions, float]:
            plain = {x: costs[Conditions(x.scene, x.size_px)].frame_ms for x in rows}
            return {x: max(0.0, cost.frame_ms - plain[x]) for x, cost in rows.items()}

        scenes: dict[str, SceneCosts] = {}
        for scene in dict.fromkeys(x.scene for x in costs):
            plain, whole = at(scene, ()), at(scene, LABELS)
            scenes[scene] = SceneCosts(
                Line.fit({x: cost.frame_ms for x, cost in plain.items()}),
                Line.fit(beside(whole)),
                {
                    part: Power.fit({x: cost.kb[part] for x, cost in whole.items()})
                    for part in (IMAGES, *LABELS)
                },
                min(cost.drive_s for cost in (plain | whole).values()),
            )
        (of_all,) = (ms for x, ms in beside(at(BASE, LABELS)).items() if x.size_px == LARGE_PX)
        plain_kb = sum(x.kb[IMAGES] for x in at(BASE, ()).values())
        return CostModel(
            scenes,
            {x: sum(beside(at(BASE, (x,))).values()) / of_all for x in LABELS},
            {x: Line.fit(beside(at(BASE, (), x))) for x in CAMERAS},
            {
                x: sum(cost.kb[IMAGES] for cost in at(BASE, (), x).values()) / plain_kb
                for x in CAMERAS
            },
        )

    def frame_ms(self, conditions: Conditions) -> float:
        """Predict the processor time of a frame."""
        size, scene = conditions.megapixels, self.scenes[conditions.scene]
        labels = min(1.0, sum(self.shares[x] for x in conditions.labels)) * scene.labels.at(size)
        camera = self.cameras[conditions.camera].at(size) if conditions.camera else 0.0
        return scene.images.at(size) + labels + camera

    def frame_kb(self, conditions: Conditions) -> float:
        """Predict the kilobytes of a frame."""
        kb = self.scenes[conditions.scene].kb
        parts = {x: kb[x].at(conditions.megapixels) for x in (IMAGES, *conditions.labels)}
        parts[IMAGES] *= self.image_kb.get(conditions.camera, 1.0)
        return sum(parts.values())


def million_frames(model: CostModel, conditions: Conditions) -> tuple[float, float]:
    """Predict core-hours and gigabytes of a million frames, without what drives cost once."""
    hours, gb = model.frame_ms(conditions) * 1e6 / 3.6e6, model.frame_kb(conditions) * 1e6 / 2**20
    return hours, gb
