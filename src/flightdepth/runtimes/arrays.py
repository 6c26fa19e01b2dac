"""What pictures and maps are called."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]  # RGB [H, W, 3] or grey [H, W]
Maps = NDArray[np.float32]  # depth and the like [h, w], or several of them
Flags = NDArray[np.bool_]  # of the pixels of such a map
