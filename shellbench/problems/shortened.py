"""Numbers in a shorter floating-point format, as a compact file would keep them.

A format of 16 bits holds magnitudes from 6e-5 to 65504 only (IEEE 754-2008, binary16). An array is therefore scaled
before it is rounded, so that its largest magnitude comes near the largest number of the format. The scale is a power
of two: scaling rounds nothing, and numbers that are already of the format stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import NumberFormat

Array = NDArray[np.float64]

EXPONENT_BYTES = 2  # of the exponent that is kept with a scaled array: double precision needs 11 bits of it


@dataclass(frozen=True)
class Shortened:
    """An array as it is kept: numbers times a power of two.

    Attributes
    ----------
    numbers
        In the format.
    exponent
        Of the power of two by which they are to be multiplied.
    """

    numbers: NDArray[np.floating[Any]]
    exponent: int = 0

    @property
    def nbytes(self) -> int:
        """Bytes of the numbers, and of the exponent if there is one."""
        return self.numbers.nbytes + (EXPONENT_BYTES if self.exponent else 0)

    def expanded(self) -> Array:
        """Return the array in double precision; without a copy if it is kept so."""
        return expanded(self.numbers, self.exponent)


def shortened(array: NDArray[np.floating[Any]], format: NumberFormat) -> Shortened:
    """Round an array to the nearest numbers of a format; an array that already fits the format stays as it is.

    Each number x then errs by at most 2**-p |x|, with p = 24 in float32 and p = 11 in float16, where numbers below
    2**-28 of the largest one may err by 2**-39 of it.
    """
    kind = np.dtype(format)
    if array.dtype.itemsize <= kind.itemsize:
        return Shortened(array)
    largest = max(float(array.max()), -float(array.min())) if array.size else 0.0
    exponent = int(np.frexp(largest)[1]) - int(np.finfo(kind).maxexp) + 1 if np.isfinite(largest) and largest else 0
    numbers = np.empty(array.shape, dtype=kind)
    np.ldexp(array, -exponent, out=numbers, casting="same_kind")  # through small buffers: no copy of the array
    return Shortened(numbers, exponent)


def expanded(numbers: NDArray[np.floating[Any]], exponent: int) -> Array:
    """Return numbers times a power of two in double precision; the very same array if nothing changes."""
    if not exponent and numbers.dtype == np.float64:
        return np.asarray(numbers)
    return np.asarray(np.ldexp(numbers.astype(np.float64), exponent))
