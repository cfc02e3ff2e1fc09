"""A line between two processes, of which one runs code of others: JSON with arrays, and never anything executable.

Each message follows its length. The waiting end checks regularly if the other end has used up its time.
"""

from __future__ import annotations

import base64
import json
import re
import select
import socket
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

HEADER = struct.Struct("<Q")
LONGEST = 1 << 30  # bytes of a message
CHUNK = 1 << 20
LOOK = 0.2  # seconds between two checks
ARRAY = "$array"
PLAIN = re.compile(r"[<>|=]?(b1|[iu][1248]|f(2|4|8|16)|c(8|16|32)|[SU]\d{1,9})")  # types of numbers and of text

Look = Callable[[], None]  # raises to stop the wait


def wait_without_limit() -> None:
    """Wait on."""


class Line:
    """One end of the line."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self.end = end

    @property
    def closed(self) -> bool:
        """True if this end has been closed."""
        return self.end.fileno() < 0

    def close(self) -> None:
        """Close this end."""
        self.end.close()

    def send(self, message: Any, look: Look = wait_without_limit) -> None:
        """Send JSON data and arrays.

        Raises
        ------
        TypeError, ValueError
            If the message contains other data.
        OSError
            If the other end is closed.
        """
        data = json.dumps(message, default=_coded).encode()
        left = memoryview(HEADER.pack(len(data)) + data)
        while left:
            self._wait(select.POLLOUT, look)
            left = left[self.end.send(left[:CHUNK]) :]

    def receive(self, look: Look = wait_without_limit) -> Any:
        """Return the next message.

        Raises
        ------
        EOFError, OSError
            If the other end is closed.
        ValueError
            If the received data are no message.
        """
        (size,) = HEADER.unpack(self._exactly(HEADER.size, look))
        if size > LONGEST:
            raise ValueError("a message is too long")
        try:
            return json.loads(self._exactly(size, look), object_hook=_decoded)
        except (TypeError, RecursionError):
            raise ValueError("a message has no array where it says so, or is nested too deeply") from None

    def _exactly(self, size: int, look: Look) -> bytes:
        data = bytearray()
        while len(data) < size:
            self._wait(select.POLLIN, look)
            chunk = self.end.recv(min(size - len(data), CHUNK))
            if not chunk:
                raise EOFError
            data += chunk
        return bytes(data)

    def _wait(self, event: int, look: Look) -> None:
        poll = select.poll()
        poll.register(self.end, event)
        look()
        while not poll.poll(1000 * LOOK):
            look()


def _coded(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic) and PLAIN.fullmatch((array := np.asarray(value)).dtype.str):
        return {ARRAY: [array.dtype.str, array.shape, base64.b64encode(array.tobytes()).decode()]}
    raise TypeError(f"{type(value).__name__} is neither JSON nor an array of numbers")


def _decoded(data: dict[str, Any]) -> Any:
    match data:
        case {"$array": [str() as kind, list() as shape, str() as text]} if PLAIN.fullmatch(kind):
            return np.frombuffer(base64.b64decode(text), kind).reshape(shape).copy()
    return data
