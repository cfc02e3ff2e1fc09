"""Files of solutions: npz without pickles, arrays beside one text of JSON."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError

Array = NDArray[np.float64]
T = TypeVar("T")

MARK = "cst-hinge, format 1"
DAMAGE = (ValueError, KeyError, TypeError, EOFError, IndexError, zipfile.BadZipFile, zlib.error)


def write(path: Path, words: Mapping[str, Any], arrays: Mapping[str, Array]) -> Path:
    """Write JSON data and arrays; return the file's path, which ends in .npz."""
    target = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
    text = json.dumps({"mark": MARK, **words})
    np.savez(target, allow_pickle=False, words=np.asarray(text), **arrays)
    return target


def read(path: Path, assemble: Callable[[Mapping[str, Any], Mapping[str, Array]], T]) -> T:
    """Read what `write` wrote, and make of it what `assemble` does.

    Raises
    ------
    InputError
        If the file is missing, damaged, or not a solution of this solver.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        words = json.loads(str(arrays.pop("words")))
        if words["mark"] != MARK:
            raise ValueError("of another format")
        return assemble(words, arrays)
    except OSError as error:
        raise InputError(f"{path}: can't be read as a solution of cst-hinge ({error.strerror or 'damaged'})") from None
    except DAMAGE:
        raise InputError(f"{path}: is damaged, or not a solution of cst-hinge") from None
