"""The client's end of a Dask scheduler: connect, know its workers, and notice when it is gone."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from shellbench import engine
from shellbench.errors import InputError, ShellbenchError

PATIENCE = 10.0  # seconds for a scheduler to answer
MUST_AGREE = ("python", "distributed")  # what Dask needs to be the same at both ends to understand each other


class SchedulerLostError(ShellbenchError):
    """The scheduler is gone in mid-run."""


@dataclass(frozen=True)
class Scheduler:
    """A scheduler that is connected.

    Attributes
    ----------
    address
        As it was given.
    client
        A `distributed.Client`.
    """

    address: str
    client: Any

    def workers(self) -> dict[str, int]:
        """Return the threads of each worker by its address.

        Raises
        ------
        SchedulerLostError
            If the scheduler does not answer.
        """
        with self.losses_said():
            return dict(self.client.sync(self.client.scheduler.ncores, callback_timeout=PATIENCE))

    def misfits(self) -> dict[str, str]:
        """Return why the workers whose versions differ from ours can't be used, by their addresses."""
        with self.losses_said():
            found = self.client.get_versions()
        ours = _versions(found["client"])
        reasons = {address: _difference(_versions(answer), ours) for address, answer in found["workers"].items()}
        return {address: reason for address, reason in reasons.items() if reason}

    @contextlib.contextmanager
    def losses_said(self) -> Iterator[None]:
        """Turn whatever a lost connection raises into one sentence."""
        self.check()
        try:
            yield
        except Exception as error:
            if isinstance(error, OSError) or self.client.status != "running":  # a time-out is an OSError too
                raise self.lost() from error
            raise

    def check(self) -> None:
        """Make sure that the connection still stands."""
        if self.client.status != "running":
            raise self.lost()

    def lost(self) -> SchedulerLostError:
        """Return the error that says that the scheduler is gone."""
        return SchedulerLostError(
            f"the scheduler {self.address} is gone: what had ended is kept, and the same command goes on from there"
        )


@contextlib.contextmanager
def connected(given: str) -> Iterator[Scheduler]:
    """Connect to a scheduler by its address or its scheduler file.

    Raises
    ------
    InputError
        If `distributed` is not installed, no scheduler answers there, or its versions differ from ours.
    """
    need_dask()
    address = address_of(given)
    distributed = import_module("distributed")
    ours = import_module("distributed.versions").get_versions()
    with _quiet():
        try:  # before a client connects, which may not even understand a scheduler of another version
            kind, theirs = asyncio.run(_ask(address))
            if kind != "Scheduler":
                raise InputError(f"--scheduler {given}: it is the address of a Dask {kind.lower()}, not of a scheduler")
            difference = _difference(_versions(theirs), _versions(ours))
            if difference:
                raise InputError(f"--scheduler {given}: it {difference}; use the same versions at both ends")
            client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RuntimeError, ImportError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"--scheduler {given}: no Dask scheduler answers there ({_first(error)})") from None
        try:
            yield Scheduler(given, client)
        finally:
            with contextlib.suppress(Exception):  # of a lost scheduler there is nothing left to close
                client.close(timeout=PATIENCE)


async def _ask(address: str) -> tuple[str, Mapping[str, Any]]:
    """Return what a program of Dask is, ``Scheduler``, ``Worker`` or ``Nanny``, and its versions."""
    secure = import_module("distributed").Security().get_connection_args("client")
    rpc = import_module("distributed.core").rpc
    async with rpc(address, timeout=PATIENCE, connection_args=secure) as there:
        who = await asyncio.wait_for(there.identity(), PATIENCE)
        if who["type"] != "Scheduler":
            return str(who["type"]), {}
        return str(who["type"]), await asyncio.wait_for(there.versions(packages=[]), PATIENCE)


def need_dask() -> None:
    """Make sure that `distributed` is installed.

    Raises
    ------
    InputError
        If not; it says which extra to install.
    """
    try:
        engine.need("dask", ["distributed"])
    except InputError as error:
        raise InputError(f"--scheduler: {error}") from None


def address_of(given: str) -> str:
    """Return the address that was given, or that a scheduler file names.

    Raises
    ------
    InputError
        If it is neither.
    """
    if "://" in given or not (given.endswith(".json") or Path(given).exists()):
        host, _, port = given.rpartition(":")
        if not host or not port.rstrip("/").isdigit():
            raise InputError(
                f"--scheduler {given}: expected an address such as tcp://127.0.0.1:8786, or a scheduler file"
            )
        return given
    try:
        address = json.loads(Path(given).read_text(encoding="utf-8"))["address"]
    except OSError as error:
        raise InputError(f"--scheduler {given}: can't be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--scheduler {given}: is no scheduler file, for it names no address") from None
    return str(address)


def _versions(answer: Mapping[str, Any]) -> dict[str, str]:
    packages = answer.get("packages", {})
    found = {name: str(packages.get(name)) for name in MUST_AGREE}
    found["python"] = ".".join(found["python"].split(".")[:2])
    return found


def _difference(theirs: Mapping[str, str], ours: Mapping[str, str]) -> str | None:
    different = [name for name in MUST_AGREE if theirs[name] != ours[name]]
    if not different:
        return None
    return "has " + ", ".join(f"{name} {theirs[name]} (here {ours[name]})" for name in different)


def _first(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return (text or type(error).__name__).partition(". ")[0]


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence what Dask would write to standard error: what matters is said in one sentence."""
    logger = logging.getLogger("distributed")
    levels = {log: log.level for log in (logger, logging.getLogger("distributed.client"))}
    for log in levels:
        log.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for log, level in levels.items():
            log.setLevel(level)
