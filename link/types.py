"""Types of the arrays that the project hands around, each with its shape, dtype, range and unit.

numpy's types know the dtype alone. What is said below a name holds wherever an argument or a result
has that type, so that its docstring need not say it again.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Any shape, float64."""
Floats = NDArray[np.float32]
"""Any shape, float32."""
Real = NDArray[np.floating[Any]]
"""Any shape, float32 or float64."""
Map = NDArray[np.float32]
"""(H, W) float32, a value for each pixel of an image or each point of a plane."""
Gray = NDArray[np.uint8]
"""(H, W) uint8 in [0, 255], encoded luma."""
Image = NDArray[np.uint8]
"""(H, W), which is gray, or (H, W, 3), which is RGB; uint8 in [0, 255], encoded."""
Corners = NDArray[np.float64]
"""(4, 2) float64, x and y in pixels, whole at pixel centres: top left, top right, bottom right and
bottom left of the displayed picture, whatever way up the camera was."""
Homography = NDArray[np.float64]
"""(3, 3) float64, maps points (x, y, 1) up to a factor. They are pixels, whole at their centres,
where nothing else is said."""
