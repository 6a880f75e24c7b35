"""The process around a command: output that any terminal takes, a pipe that closes, signals that end it at once.

XLA compiles and computes in calls that Python's signal handlers wait for. So a thread of its own watches for signals,
gives the command a moment to end by itself, and then ends the process.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from typing import Any, NoReturn, TextIO

from coopmm_jax import files
from coopmm_jax.errors import Notice, one_line

CLOSED_PIPE = 128 + 13  # the exit code of what a closed pipe ends
GRACE = 1.0  # [s] for a command to end by itself
_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "terminal closed"}
_ending = threading.Lock()


class Stopped(KeyboardInterrupt):
    """A signal that ends the process."""

    def __init__(self, number: int = signal.SIGINT):
        super().__init__(number)
        self.number = number


def prepare() -> None:
    """Make the process fit for any terminal, and let signals end it within about ``GRACE``."""
    for descriptor in range(3):  # a closed one would go to the next file that is opened
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout, sys.stderr = _tolerant(sys.stdout), _tolerant(sys.stderr)
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in _WORDS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, _stop)
    threading.Thread(target=_watch, args=(reading,), name="signals", daemon=True).start()


def say(text: str) -> None:
    """Print one line on stderr, if anyone is there to read it."""
    with contextlib.suppress(OSError, ValueError):
        print(f"coopmm: {one_line(text)}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def notices(only: bool) -> Iterator[None]:
    """Print this package's warnings as one line each.

    Args:
        only: no others, which would be those of libraries and not for the user of a command.
    """

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, Notice):
            say(f"{category.label}: {message}")
        else:
            usual(message, category, *where, **more)

    with warnings.catch_warnings():
        usual = warnings.showwarning
        if only:
            warnings.simplefilter("ignore")
        warnings.simplefilter("always", Notice)
        warnings.showwarning = show
        yield


def close_pipe() -> int:
    """Let nothing more be written where nobody reads; the exit code."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return CLOSED_PIPE


def end(number: int) -> NoReturn:
    """End the process, which a signal asks for: unfinished files go, finished ones stay."""
    with _ending:  # whoever comes second waits for the end
        say(_WORDS.get(signal.Signals(number), "ended"))
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
        files.abandon()
        os._exit(128 + number)


def _stop(number: int, _: Any) -> NoReturn:
    raise Stopped(number)


def _watch(reading: int) -> NoReturn:
    """End the process a moment after the first of its signals, or at the second."""
    number = 0
    while number not in _WORDS:
        number = os.read(reading, 1)[0]
    select.select([reading], [], [], GRACE)
    end(number)


def _tolerant(stream: Any) -> TextIO:  # a TextIOWrapper, or what was put into its place; None if it is closed
    """A stream that spells out what its encoding does not have."""
    if stream is None:
        return open(os.devnull, "w")
    stream.reconfigure(errors="backslashreplace")
    return stream
