"""Array types by content."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]
"""Real numbers; the docstring gives shape, unit and frame."""

Image: TypeAlias = NDArray[np.uint8]
"""(H, W) grey, uint8, pixel centres on integers."""

Indices: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]
