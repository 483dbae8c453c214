"""`driftyard point-world`: the estimator and the Cramér-Rao bound on noisy points."""

import numpy as np

from trials.cli import console
from trials.cli.options import option
from trials.studies.point_world import TOLERANCE, compare_with_bound


def point_world(
    worlds: int = option(200, "Number of random worlds.", min=2),
    seed: int = option(0, "Random seed of the first world.", min=0),
) -> None:
    """Print the error of bundle adjustment over its bound: root mean square of worlds and poses."""
    achieved, bound = np.sqrt(compare_with_bound(range(seed, seed + worlds)))
    for k, (name, unit) in enumerate((("position", "mm"), ("rotation", "mrad"))):
        ratio = achieved[k] / bound[k]
        verdict = "reached" if abs(ratio - 1) <= TOLERANCE else "MISSED"
        console.out.print(
            f"{name}: {1e3 * achieved[k]:.4f} {unit}, bound {1e3 * bound[k]:.4f} {unit}, "
            f"ratio {ratio:.3f} over {worlds} worlds: {verdict} (within {TOLERANCE:.0%})"
        )
