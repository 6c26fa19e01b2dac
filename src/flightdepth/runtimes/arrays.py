"""What pictures and maps are called."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Maps = NDArray[np.float32]  # depth and the like [h, w], or several of them
Flags = NDArray[np.bool_]  # of the pixels of such a map
