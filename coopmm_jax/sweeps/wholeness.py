"""Checksums of a store, which tell the batches that are whole, and changes of what describes them.

A batch's checksum is written when all of it is there, so a batch without one has not been computed yet, and one that
does not match has been damaged since.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import zarr
from zarr.storage import LocalStore

CHECKSUMS = "checksums"  # array (batch), 0 for none
FINGERPRINT = "fingerprint"  # attribute
_UNREADABLE = 2  # checksums are odd
BLOCK = 32  # batches that are read at once


class Batches(NamedTuple):
    """State of all batches of a store."""

    whole: np.ndarray  # (batches,) of bool
    damaged: dict[int, str]  # number of a batch -> what is wrong with it


def checksum(rows: Mapping[str, np.ndarray]) -> np.uint64:
    """Checksum of the arrays (B, ...) of one batch by name; those without rows do not count."""
    digest = hashlib.blake2b(digest_size=8)
    for name in sorted(rows):
        if len(rows[name]):
            digest.update(name.encode() + np.ascontiguousarray(rows[name]).tobytes())
    return np.uint64(int.from_bytes(digest.digest(), "little") | 1)


def fingerprint(settings: Mapping[str, Any], coordinates: Mapping[str, np.ndarray | Sequence[str]]) -> str:
    """Checksum of a store's settings and of its coordinates (n,) by name."""
    written = {name: value for name, value in settings.items() if name != FINGERPRINT}
    known = {name: np.asarray(values).tolist() for name, values in coordinates.items()}
    return hashlib.blake2b(json.dumps([written, known], sort_keys=True).encode(), digest_size=16).hexdigest()


def inspect(group: zarr.Group, arrays: Mapping[str, zarr.Array], size: int) -> Batches:
    """Read everything and compare it with its checksums.

    Args:
        group: the store.
        arrays: what is written batch by batch (samples, ...), by name.
        size: samples of a batch.
    """
    given = written(group)
    whole, damaged = np.zeros(len(given), bool), dict[int, str]()
    for first in range(0, len(given), BLOCK):
        for batch, found in _checksums(arrays, size, first, min(first + BLOCK, len(given))):
            whole[batch] = given[batch] != 0 and given[batch] == found
            if given[batch] != 0 and given[batch] != found:
                samples = f"samples {batch * size} to {min((batch + 1) * size, arrays['status'].shape[0]) - 1}"
                damaged[batch] = f"{samples}: {_reason(group, arrays, size, batch)}"
    return Batches(whole, damaged)


def written(group: zarr.Group) -> np.ndarray:
    """Checksums of a store (batches,), 0 for none; one that cannot be read is none that anything has."""
    array = cast(zarr.Array, group[CHECKSUMS])
    try:
        return np.asarray(array[:])
    except Exception:  # whatever zarr makes of a damaged file
        return np.array([_readable(array, batch) for batch in range(array.shape[0])], np.uint64)


def _readable(array: zarr.Array, batch: int) -> int:
    try:
        return int(np.asarray(array[batch]))
    except Exception:  # whatever zarr makes of a damaged file
        return _UNREADABLE


def _checksums(
    arrays: Mapping[str, zarr.Array], size: int, first: int, end: int
) -> Iterator[tuple[int, np.uint64 | None]]:
    """Checksum of each of some batches as they can be read; None for one that cannot."""
    try:
        rows = {name: np.asarray(array[first * size : end * size]) for name, array in arrays.items()}
    except Exception:  # whatever zarr makes of a damaged file
        middle = (first + end) // 2
        if end - first == 1:
            yield first, None
        else:
            yield from _checksums(arrays, size, first, middle)
            yield from _checksums(arrays, size, middle, end)
        return
    for batch in range(first, end):
        window = slice((batch - first) * size, (batch - first + 1) * size)
        yield batch, checksum({name: values[window] for name, values in rows.items()})


def _reason(group: zarr.Group, arrays: Mapping[str, zarr.Array], size: int, batch: int) -> str:
    """File that is at fault, as far as it shows."""
    for name, array in arrays.items():
        if batch * size < array.shape[0]:
            file = Path(name, "c", str(batch), *["0"] * (array.ndim - 1))
            if not (cast(LocalStore, group.store).root / file).exists():
                return f"{file} is missing"
            try:
                array[batch * size : (batch + 1) * size]
            except Exception:  # whatever zarr makes of a damaged file
                return f"{file} is corrupt"
    return "another content than was written"
