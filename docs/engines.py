"""Draws docs/images/engines.jpg: the start of every scene by both engines, classic on the left.

python docs/engines.py
"""

from pathlib import Path

import cv2
import numpy as np

from scenes import SCENES
from trials.studies.speed.engines import measure_engines

WIDTH_PX, COLUMNS, SEED = 240, 3, 0
OUT = Path(__file__).parent / "images/engines.jpg"


def main() -> None:
    """Render, label and join the pictures."""
    tiles = []
    for scene in SCENES:
        classic, _, filament = measure_engines(scene, SEED, WIDTH_PX, True, 1).images
        tile = np.ascontiguousarray(np.hstack([classic, filament])[..., ::-1])
        for colour, thick in (((0, 0, 0), 3), ((255, 255, 255), 1)):
            cv2.putText(
                tile, scene, (5, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, thick, cv2.LINE_AA
            )
        tiles.append(
            cv2.copyMakeBorder(tile, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255))
        )
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
    rows = [np.hstack(tiles[k : k + COLUMNS]) for k in range(0, len(tiles), COLUMNS)]
    cv2.imwrite(str(OUT), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main()
