"""Arrays by the kind of number in them; ``records.FloatArray`` is the one of 64 bits."""

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]
ByteArray = npt.NDArray[np.uint8]
Float32Array = npt.NDArray[np.float32]
IndexArray = npt.NDArray[np.intp]
