"""Programs: solvers that are a command in any language, each described by a TOML file.

The identity of such a solver is a fingerprint. It changes with the file, with the executable, with every file that the
command names, and with the words that the program prints about its version. A changed program is therefore never
answered by an old record. A program is started from a list of arguments, never by a shell.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import time
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, ValidationError

from shellbench.errors import InputError
from shellbench.protocol.schema import Model, one_sentence, read_toml

NAME_PATTERN = r"^[a-z][a-z0-9]*([-_][a-z0-9]+)*$"
PATIENCE = 30.0  # seconds for a program to print its version
FRESH = 5.0  # seconds for which it is not asked again, since a plan has many runs; each run asks it anew
CALLERS_PATH = "SHELLBENCH_CALLERS_PYTHONPATH"  # where shellbench's processes keep the user's PYTHONPATH
DIGITS = 16  # of a fingerprint


def callers_environment() -> dict[str, str]:
    """Return the environment of the user: shellbench's own processes have another path to Python's modules."""
    found = dict(os.environ)
    if (path := found.pop(CALLERS_PATH, None)) is not None:
        found.pop("PYTHONPATH", None)
        found |= {"PYTHONPATH": path} if path else {}
    return found


class Program(Model):
    """The part of a file by which a solver is found and identified.

    Attributes
    ----------
    name
        In tables and records: small letters, digits, - and _; that of the file if not given.
    command
        The command with its arguments, as typed. The program is looked for in PATH, or from the file's folder if it has
        a slash. {here} is that folder. An argument that is a file seen from it is passed with its whole path.
    version
        A command that prints the program's version, and does not print a date.
    files
        Patterns of further files on which the answers depend, seen from the file's folder.
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=60)]
    command: Annotated[str, Field(pattern=r"\S")]
    version: Annotated[str, Field(pattern=r"\S")]
    files: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read what a class describes of a file, without fields of its subclasses; InputError."""
        data = read_toml(path)
        data.setdefault("name", path.stem.lower())
        known = data if cls is not Program else {key: data[key] for key in cls.model_fields if key in data}
        try:
            return cls.model_validate(known)
        except ValidationError as error:
            raise InputError(f"{path}: {one_sentence(error, data)}") from None

    def arguments(self, path: Path, field: str = "command") -> list[str]:
        """Return the list of arguments of a command; InputError if the program is not there."""
        here = path.resolve().parent
        try:
            program, *rest = (part.replace("{here}", str(here)) for part in shlex.split(str(getattr(self, field))))
        except ValueError as error:
            raise InputError(f"{path}: field '{field}': {str(error).lower()}") from None
        found = shutil.which(str(here / program) if "/" in program else program)
        if found is None:
            raise InputError(f"{path}: field '{field}': there is no program '{program}'")
        return [str(Path(found).absolute()), *(str(here / part) if (here / part).is_file() else part for part in rest)]

    def fingerprint(self, path: Path) -> str:
        """Return hexadecimal digits that change with the program; InputError if a part of it is missing."""
        here = path.resolve().parent
        used = [path, *(Path(p) for f in ("command", "version") for p in self.arguments(path, f) if Path(p).is_file())]
        for pattern in self.files:
            relative = bool(pattern) and not Path(pattern).is_absolute()
            matched = sorted(one for one in here.glob(pattern) if one.is_file()) if relative else []
            if not matched:
                raise InputError(f"{path}: field 'files': there is no file '{pattern}' in its folder")
            used += matched
        parts = [hashlib.sha256(one.read_bytes()).hexdigest() for one in used]
        return hashlib.sha256("\n".join([*parts, self.version_words(path)]).encode()).hexdigest()[:DIGITS]

    def version_words(self, path: Path) -> str:
        """Return the words of the program about its version; InputError if it prints nothing."""
        try:
            return _printed(tuple(self.arguments(path, "version")), path.resolve().parent, time.monotonic() // FRESH)
        except InputError as error:
            raise InputError(f"{path}: field 'version': '{self.version}' {error}") from None


@lru_cache(maxsize=16)
def _printed(command: tuple[str, ...], folder: Path, period: float) -> str:
    """Return the output of a command on one line, asked once for each period; InputError as a clause."""
    out, merged, env = subprocess.PIPE, subprocess.STDOUT, callers_environment()
    try:
        done = subprocess.run(command, input=b"", stdout=out, stderr=merged, cwd=folder, env=env, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        raise InputError(f"did not end within {PATIENCE:g} s") from None
    except OSError as error:
        raise InputError(f"can't be started ({error.strerror})") from None
    if not (words := " ".join(done.stdout.decode(errors="replace").split())):
        raise InputError("prints nothing")
    return words
