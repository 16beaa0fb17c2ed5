"""Arrays as compiled functions take them: contiguous, of int or float, with their number of dimensions said."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

Ints1 = Annotated[NDArray[np.int64], 1]
Ints2 = Annotated[NDArray[np.int64], 2]
Floats1 = Annotated[NDArray[np.float64], 1]
Floats2 = Annotated[NDArray[np.float64], 2]
Floats3 = Annotated[NDArray[np.float64], 3]
