"""A yard of a few boxes that is built and drawn in no time, for tests of trials in it."""

from pathlib import Path

import cv2
import numpy as np

YARD = """<mujoco>
<visual><headlight active="0"/></visual>
<asset>
 <texture name="noise" type="2d" file="noise.png"/>
 <material name="ground" texture="noise" texuniform="true" texrepeat=".5 .5" specular="0"/>
</asset>
<worldbody>
 <light type="directional" dir=".3 .2 -1" ambient=".4 .4 .4"/>
 <geom name="ground" type="plane" size="6 6 1" material="ground"/>
 <geom name="north" type="box" pos="0 3.05 .3" size="3.1 .05 .3" material="ground"/>
 <geom name="south" type="box" pos="0 -3.05 .3" size="3.1 .05 .3" material="ground"/>
 <geom name="east" type="box" pos="3.05 0 .3" size=".05 3.1 .3" material="ground"/>
 <geom name="west" type="box" pos="-3.05 0 .3" size=".05 3.1 .3" material="ground"/>
 <geom name="pillar" type="cylinder" pos="0 0 .3" size=".3 .3" material="ground"/>
 <geom name="roof" type="box" pos="-2 2 1.5" size=".5 .5 .1" material="ground"/>
 <geom name="mat" type="box" pos="2 -2 .01" size=".4 .4 .01" material="ground"/>
</worldbody></mujoco>"""
"""6 x 6 m between walls; a pillar in the middle, a roof overhead and a mat underfoot."""

PLAIN = 'builtin="checker" width="64" height="64" rgb1=".5 .5 .5" rgb2=".4 .4 .4"'
"""In the place of the texture's file, where there is none."""


def write_yard(folder: Path) -> Path:
    """Write the yard as an MJCF file, with blobs of some centimetres on everything."""
    coarse = np.random.default_rng(1).integers(60, 190, (96, 96), dtype=np.uint8)
    smooth = cv2.resize(coarse, (512, 512), interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(folder / "noise.png"), smooth)
    file = folder / "yard.xml"
    file.write_text(YARD)
    return file
