"""What passes between the evaluation and the process of a solver: requests, answers, and arrays in shared memory.

Requests are pickled, for the evaluation is trusted at both ends. Answers are not, because a solver may have written them: an
answer has some numbers and two short texts. Arrays have shapes that both ends know beforehand, and the evaluation copies
them before it looks at them.
"""

from __future__ import annotations

import math
import mmap
import os
import socket
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Number of the call, and length of the pickled request; without a request the last call is made once more.
REQUEST = struct.Struct("<II")
ANSWER = struct.Struct("<IBqHH")  #: number of the call, kind, value, and the lengths of two texts
END = struct.Struct("<ci")  #: what the keeper of a process tells: STARTED with its number, or ENDED with its status
STARTED, ENDED = b"s", b"e"
STOPPED = b"t"  #: asks for the end of keepers that a solver has stopped
DONE, FAILED, REFUSED, BEAT = range(4)  #: kinds of an answer; a beat tells that the call goes on
MAX_TEXT = 4000  #: most bytes of a text; more is cut

#: Name, dtype and shape of an array in shared memory.
Layout = Sequence[tuple[str, str, tuple[int, ...]]]
_ALIGNED = 64


class Answer(NamedTuple):
    """Answer of a call."""

    value: int = 0
    first: str = ""
    second: str = ""


def packed(number: int, kind: int, answer: Answer) -> bytes:
    """Return an answer to the call of that number as bytes. Each of its texts is UTF-8 of at most MAX_TEXT bytes."""
    value, first, second = answer
    if not (first or second):
        return ANSWER.pack(number, kind, value, 0, 0)
    head = first[:MAX_TEXT].encode("utf-8", "replace")[:MAX_TEXT]
    tail = second[-MAX_TEXT:].encode("utf-8", "replace")[-MAX_TEXT:]  # the end of a traceback tells most
    return ANSWER.pack(number, kind, value, len(head), len(tail)) + head + tail


def size_of(layout: Layout) -> int:
    """Return the number of bytes that the arrays of a layout take."""
    return sum(_padded(dtype, shape) for _, dtype, shape in layout)


def shared(memory: int, layout: Layout) -> dict[str, NDArray[Any]]:
    """Return the arrays of a layout as views of a shared memory, given by its file descriptor and large enough."""
    buffer = mmap.mmap(memory, max(size_of(layout), 1))
    found, at = {}, 0
    for name, dtype, shape in layout:
        found[name] = np.frombuffer(buffer, dtype, math.prod(shape), at).reshape(shape)
        at += _padded(dtype, shape)
    return found


def _padded(dtype: str, shape: tuple[int, ...]) -> int:
    return -(-np.dtype(dtype).itemsize * math.prod(shape) // _ALIGNED) * _ALIGNED


def new_memory(layout: Layout) -> int:
    """Return the file descriptor of a new shared memory for a layout, whose size nobody can change any more."""
    import fcntl  # not on every system

    memory = os.memfd_create("sins-env", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(memory, max(size_of(layout), 1))
    fcntl.fcntl(memory, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
    return memory


def exactly(data: socket.socket, size: int) -> bytes:
    """Receive so many bytes.

    Raises:
        EOFError: the other end is closed.
    """
    found = bytearray(size)
    view = memoryview(found)
    while view:
        count = data.recv_into(view)
        if not count:
            raise EOFError
        view = view[count:]
    return bytes(found)


def received(memories: int, layout: Layout) -> dict[str, NDArray[Any]]:
    """Return the arrays of a layout in the next shared memory that comes through a socket, given by its descriptor."""
    with socket.socket(fileno=os.dup(memories)) as come:
        _, (memory,), _, _ = socket.recv_fds(come, 1, 1)
    try:
        return shared(memory, layout)
    finally:
        os.close(memory)
