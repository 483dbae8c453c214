"""Finishes of materials for a physically based renderer, by the materials' names."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finish:
    """How a surface reflects: roughness from 0, a mirror, to 1, matte; and whether it is metal."""

    roughness: float
    metallic: float = 0.0


MATTE = Finish(0.9)
"""Stone, soil, cloth, paper, leaves and all that has no other finish."""
_METAL, _PAINTED, _WOOD = Finish(0.45, 1.0), Finish(0.5), Finish(0.65)
_SMOOTH, _GLASS = Finish(0.35), Finish(0.1)
_NAMES = (
    (_METAL, "steel brass bronze"),
    (_PAINTED, "iron panel drawer shell post beam red dark cone band container shutter radiator"),
    (_PAINTED, "accent frame leaf floor terrazzo planks oak_planks dark_planks cover signs plates"),
    (_PAINTED, "drums labels pedestal gas paint"),
    (_WOOD, "oak beech timber pine wood sill books cartons posters roof"),
    (_SMOOTH, "plastic keyboard screens marble worktop wraps fronts lamps"),
    (_GLASS, "glass water"),
)
FINISHES: dict[str, Finish] = {name: x for x, names in _NAMES for name in names.split()}


def finish_of(material: str) -> Finish:
    """Return the finish of a material of the scenes; a number at its end does not count."""
    return FINISHES.get(material, FINISHES.get(material.rstrip("0123456789").rstrip("_"), MATTE))
