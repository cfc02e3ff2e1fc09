"""One thread a test process: the processes of pytest-xdist share the cores, and BLAS threads would fight over them."""

import gc
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def pytest_collection_finish() -> None:
    """Let Python look for cycles in what tests make, and not, again and again, in torch and in thousands of tests."""
    gc.collect()
    gc.freeze()
