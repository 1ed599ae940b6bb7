"""Names of numpy's types."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # of numbers of any type, or of rows of fields
Floats = NDArray[np.float64]
