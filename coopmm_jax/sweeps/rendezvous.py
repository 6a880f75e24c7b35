"""Processes of a sweep wait for each other before ``jax.distributed`` does, which aborts one that waits in vain.

>>> address("localhost:1234")
('localhost', 1234)
"""

from __future__ import annotations

import re
import socket
import time
import warnings

from coopmm_jax.errors import Notice, UserError

PATIENCE = 120.0  # [s]
_OPTION = "--coordinator"
_FORM = re.compile(r"(?:\[([0-9a-fA-F:.]+)\]|([^\s:\[\]]+)):(\d{1,5})")
_GO = b"go"


def address(text: str) -> tuple[str, int]:
    """Host and port of the coordinator.

    Raises:
        UserError: other text, or a host that nobody knows.
    """
    match = _FORM.fullmatch(text)
    if match is None or not 0 < int(match[3]) < 2**16:
        raise UserError(_OPTION, "HOST:PORT, with a port from 1 to 65535", text)
    host, port = match[1] or match[2], int(match[3])
    try:
        socket.getaddrinfo(host, port)
    except (OSError, UnicodeError) as error:
        raise UserError(_OPTION, "HOST:PORT of a host that is known here", f"{text} ({error})") from None
    return host, port


def meet(coordinator: str, size: int, rank: int) -> None:
    """Wait until all ``size`` processes are there; that of rank 0 listens, the others call it.

    Raises:
        UserError: a bad address, or processes that do not come within ``PATIENCE``.

    Warns:
        Notice: what is waited for.
    """
    host, port = address(coordinator)
    end = time.monotonic() + PATIENCE
    waiting = f"{size - 1} others to call" if rank == 0 else "rank 0 to answer"
    warnings.warn(Notice(f"waiting up to {PATIENCE:g} s for {waiting} at {coordinator}"), stacklevel=2)
    try:
        if rank == 0:
            _listen(port, size - 1, end)
        else:
            _call(host, port, end)
    except OSError as error:
        must = f"where all {size} processes meet within {PATIENCE:g} s"
        raise UserError(_OPTION, must, f"{coordinator} ({error.strerror or error})") from None


def _listen(port: int, others: int, end: float) -> None:
    calls: list[socket.socket] = []
    try:
        with socket.create_server(("", port)) as server:
            while len(calls) < others:
                server.settimeout(max(0.01, end - time.monotonic()))
                calls.append(server.accept()[0])
            for call in calls:
                call.sendall(_GO)
    finally:
        for call in calls:
            call.close()


def _call(host: str, port: int, end: float) -> None:
    last: OSError = TimeoutError("timed out")
    while (left := end - time.monotonic()) > 0.0:
        try:
            with socket.create_connection((host, port), timeout=left) as call:
                if call.recv(len(_GO)) == _GO:
                    return
        except OSError as error:
            last = error
        time.sleep(min(0.2, left))
    raise last
