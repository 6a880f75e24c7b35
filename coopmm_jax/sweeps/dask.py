"""Dask's workers as an executor: those of a scheduler, or some started here.

    with connected("local:4") as executor:
        sweep("sensed", out="sensed.zarr", executor=executor)

What goes to them and comes back is told in ``engine.py``.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.software import versions

OPTION = "--dask"
_MUST = "the address of a Dask scheduler, as tcp://head:8786, or local:N"
_LOCAL = re.compile(r"local:([1-9]\d{0,3})")
# A scheme of Dask's, a host, a port.
_ADDRESS = re.compile(r"(?:(?:tcp|tls|ucx|wss?)://)?(?:\[[0-9a-fA-F:.]+\]|[\w.-]+):(\d{1,5})")
_PATIENCE = 10.0  # [s] for a scheduler to answer, and for it to have a worker


@contextlib.contextmanager
def connected(address: str) -> Iterator[Executor]:
    """Executor on the workers of a scheduler.

    Args:
        address: of the scheduler, as tcp://head:8786; or local:4 for as many processes on this machine, of one thread.

    Raises:
        UserError: Dask is not installed, nothing answers, there is no worker, or one that lacks this package or has
            other versions.
    """
    try:
        import distributed
    except ImportError:
        raise UserError(OPTION, "used where coopmm_jax[cluster] is installed", "used without Dask") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong is told by the errors below
    with contextlib.ExitStack() as stack:
        local, remote = _LOCAL.fullmatch(address), _ADDRESS.fullmatch(address)
        if local:
            address = stack.enter_context(_cluster(int(local[1])))
        elif address.startswith("local:") or remote is None or not 0 < int(remote[1]) < 2**16:
            raise UserError(OPTION, _MUST, address or "empty")
        else:
            _check_scheduler(address)
        client = stack.enter_context(distributed.Client(address, timeout=_PATIENCE, set_as_default=False))
        _check_workers(client, address)
        # What a killed worker was computing goes to another, up to the scheduler's own limit.
        yield client.get_executor(pure=False)


def _cluster(workers: int) -> Any:
    import distributed

    # One thread each: a batch keeps one core busy, and processes share none of Python's time.
    settings: dict[str, Any] = {"threads_per_worker": 1, "processes": True, "dashboard_address": None}
    return distributed.LocalCluster(n_workers=workers, silence_logs=logging.CRITICAL, **settings)


def _check_scheduler(address: str) -> None:
    """Ask before a client does: one that finds no scheduler fails once more when Python ends."""
    import distributed

    async def identity() -> Any:
        async with distributed.rpc(address) as scheduler:
            return await asyncio.wait_for(scheduler.identity(), _PATIENCE)

    try:
        asyncio.run(identity())
    except Exception as error:  # whatever it is that answers there, if anything does
        raise UserError(OPTION, _MUST, f"{address} ({type(error).__name__}: {error})") from None


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        raise UserError(OPTION, "a scheduler that has workers", f"{address} without") from None
    mine = versions()
    try:
        found = client.run(versions)
    except ImportError as error:
        raise UserError(OPTION, "a scheduler whose workers have coopmm_jax", f"{address} ({error})") from None
    except Exception as error:
        must = "a scheduler whose workers answer, with the versions of this process"
        raise UserError(OPTION, must, f"{address} ({type(error).__name__}: {error})") from None
    for worker, theirs in found.items():
        for name, version in mine.items():
            if not name.startswith("plugin ") and theirs.get(name) != version:
                must = f"a scheduler whose workers have {name} {version}, as this process has"
                raise UserError(OPTION, must, f"{theirs.get(name, 'none')} at {worker}")
