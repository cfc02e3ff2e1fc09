"""Programs: solvers that are a command in any language, each described by a TOML file.

The identity of such a solver is a fingerprint. It changes with the file, with the executable, with every file that the
command names, and with the words that the program prints about its version. A changed program is therefore never
answered by an old record. A program is started from a list of arguments, never by a shell.
"""

from __future__ import annotations

import hashlib
import shlex
import shutil
import subprocess
import time
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from shellbench.errors import InputError
from shellbench.protocol.schema import Model, one_sentence, read_toml

NAME_PATTERN = r"^[a-z][a-z0-9]*([-_][a-z0-9]+)*$"
PATIENCE = 30.0  # seconds for a program to print its version
FRESH = 5.0  # seconds for which it is not asked again, since a plan has many runs; each run asks it anew
DIGITS = 16  # of a fingerprint


class Program(Model):
    """The part of a file by which a solver is found and identified.

    Attributes
    ----------
    name
        In tables and records: small letters, digits, - and _; that of the file if not given.
    command
        The command with its arguments, as typed. The program is looked for in PATH, or from the file's folder if it has
        a slash. An argument that is a file seen from that folder is passed with its whole path.
    version
        A command that prints the program's version, and does not print a date.
    files
        Patterns of further files on which the answers depend, seen from the file's folder.
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=60)]
    command: Annotated[str, Field(min_length=1)]
    version: Annotated[str, Field(min_length=1)]
    files: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Program:
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
        try:
            program, *rest = shlex.split(str(getattr(self, field)))
        except ValueError as error:
            raise InputError(f"{path}: field '{field}': {str(error).lower()}") from None
        here = path.resolve().parent
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
        """Return what the program prints about its version; InputError if it prints nothing."""
        try:
            return _printed(tuple(self.arguments(path, "version")), path.resolve().parent, time.monotonic() // FRESH)
        except InputError as error:
            raise InputError(f"{path}: field 'version': '{self.version}' {error}") from None


@lru_cache(maxsize=16)
def _printed(command: tuple[str, ...], folder: Path, period: float) -> str:
    """Return what a command prints, on one line, once for each period; InputError as a clause."""
    out, merged, nothing = subprocess.PIPE, subprocess.STDOUT, subprocess.DEVNULL
    try:
        done = subprocess.run(
            command, stdin=nothing, stdout=out, stderr=merged, cwd=folder, timeout=PATIENCE, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"did not end within {PATIENCE:g} s") from None
    except OSError as error:
        raise InputError(f"can't be started ({error.strerror})") from None
    if not (words := " ".join(done.stdout.decode(errors="replace").split())):
        raise InputError("prints nothing")
    return words
