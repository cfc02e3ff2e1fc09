"""Two computations of one thing: equal but for rounding, which differs between processors and thread counts.

Sums of BLAS depend on the instruction set, the number of threads and where in memory an array begins: no test asks
that they agree to the last bit. What is only stored, drawn or copied is compared exactly.
"""

import numpy as np
import torch

SINGLE = 1e-5
"""Rounding of sums in single precision, of which an entry may be one."""

REPEATED = 1e-6
"""Rounding error of a solved or trained answer; another seed moves it by a hundred times that at least."""


def alike(found, expected, share=1e-12):
    """Assert that two arrays differ by no more than a share of the largest entry."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, rtol=0, atol=share * np.abs(expected).max(initial=0.0))


def same_tensors(found, expected):
    """Assert that two mappings hold the same numbers in the same layout: then the same products round alike."""
    assert found.keys() == expected.keys()
    for name, tensor in expected.items():
        assert found[name].dtype == tensor.dtype, name
        assert found[name].stride() == tensor.stride(), name
        assert torch.equal(found[name], tensor), name
