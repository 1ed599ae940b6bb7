"""Names of numpy's types."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # an array of numbers, or a structured array
Floats = NDArray[np.float64]
