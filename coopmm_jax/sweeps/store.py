"""Store of a sweep: a zarr group that xarray opens, written batch by batch by any number of processes.

A chunk holds one batch, so no two writers share a file, and each file appears whole or not at all: whatever kills a
process, the batches that have a checksum are complete.

    group attributes   scenario (TOML), sampling, batch, keep, versions (JSON), fingerprint of these and coordinates
    sample             (sample)              numbers from 0
    parameters         (sample, parameter)   drawn values, in the units of coordinate parameter_unit
    metrics            (sample, metric)      in the units of coordinate metric_unit
    status             (sample)              code of ``Status``; -1: not computed yet
    status_time        (sample)              of a failure [s]
    contact_force ...  (kept, t)             series of the first samples, see ``measure.SERIES``
    checksums          (batch)               see ``wholeness``; its attribute samples says how many there are to be
"""

from __future__ import annotations

import json
import os
import shutil
import tomllib
import warnings
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import zarr
from zarr.storage import LocalStore, MemoryStore

from coopmm_jax.errors import UserError
from coopmm_jax.files import hidden_folder, locked_folder, read_json, resolve_path
from coopmm_jax.kinds.software import check_plugins
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.validation import validate
from coopmm_jax.sweeps.contents import (
    BY_SAMPLE,
    COORDINATES,
    SAMPLE,
    Contents,
    batched,
    build,
    consolidate,
    enlarge,
    room,
)
from coopmm_jax.sweeps.wholeness import CHECKSUMS, FINGERPRINT, Batches, checksum, fingerprint, inspect, written

if TYPE_CHECKING:
    import xarray


class SweepStore:
    """An open store; ``create``, ``open_store`` and ``in_memory`` make one."""

    def __init__(self, group: zarr.Group, contents: Contents, path: Path | None, batches: Batches | None = None):
        self.path, self._contents, self._group = path, contents, group
        self._arrays = batched(group)
        self._checksums = cast(zarr.Array, group[CHECKSUMS])
        self._damaged = batches.damaged if batches else {}
        self._whole = set(np.flatnonzero(batches.whole).tolist()) if batches else set[int]()

    @property
    def samples(self) -> int:
        """Number of samples the store has room for."""
        return self._arrays["status"].shape[0]

    @property
    def batches(self) -> int:
        """Number of batches of these samples."""
        return -(-self.samples // self._contents.batch_size)

    def locked(self, rank: int) -> AbstractContextManager[None]:
        """Keep other processes of the same rank out of the store.

        Raises:
            UserError: on entering, if there is one.
        """
        if self.path is None:
            return nullcontext()
        return locked_folder(self.path / "status", "out", f".lock-{rank}")  # zarr would take it for data in a group

    def done(self, batch: int) -> bool:
        """True if a batch is complete."""
        return batch in self._whole

    def write(self, batch: int, values: Mapping[str, np.ndarray]) -> None:
        """Write one batch: arrays (B, ...) by name, the last of its B samples perhaps beyond the sweep."""
        size, rows = self._contents.batch_size, {}
        for name, given in values.items():
            array = self._arrays[name]
            window = slice(batch * size, min((batch + 1) * size, array.shape[0]))
            rows[name] = np.asarray(given[: window.stop - window.start], array.dtype)
            array[window] = rows[name]
        self._checksums[batch] = checksum(rows)
        self._whole.add(batch)
        self._damaged.pop(batch, None)

    def grow(self, samples: int) -> None:
        """Make room for more samples. A last batch that was cut short is to be computed again.

        What kills the process in between leaves a store that is made as large when it is opened again.

        Raises:
            UserError: the store has more samples already.
        """
        if samples < self.samples:
            raise UserError("samples", f"at least {self.samples}, as {self.path} has", samples)
        batch, cut = divmod(self.samples, self._contents.batch_size)
        if samples > self.samples:
            if cut:
                self._checksums[batch] = 0
                self._whole.discard(batch)
            self._checksums.attrs["samples"] = samples
            enlarge(self._group)
            self._arrays = batched(self._group)
            self._checksums = cast(zarr.Array, self._group[CHECKSUMS])

    def dataset(self) -> xarray.Dataset:
        """Everything written so far, read when it is used; samples of damaged batches count as not computed."""
        whole = written(self._group) != 0
        whole[list(self._damaged)] = False
        return _opened(self._group, Batches(whole, self._damaged))


def in_memory(contents: Contents, samples: int) -> SweepStore:
    """A store that lives as long as the process."""
    return SweepStore(build(MemoryStore(), contents, samples), contents, None)


def create(path: Path, contents: Contents, samples: int) -> SweepStore:
    """A new store at a path where nothing is; all of its files appear there at once.

    Raises:
        UserError: the path exists, or cannot be written.
    """
    if os.path.lexists(path):
        raise UserError("out", "a path where nothing is, or a sweep's store to --resume or --overwrite", path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with hidden_folder(path.parent, path.name) as hidden:
            consolidate(build(LocalStore(hidden), contents, samples))
            hidden.rename(path)
    except OSError as error:
        raise UserError("out", "a place that can be written", f"{path} ({error.strerror})") from None
    return open_store(path, contents)


def computed(path: Path) -> tuple[int, int]:
    """Samples that have been computed, and that are to be, of a store in which other processes may be at work.

    Raises:
        UserError: no store of a sweep.
    """
    try:
        group = zarr.open_group(LocalStore(path), mode="r", use_consolidated=False)
        total, size = room(group), int(str(group.attrs["batch"]))
        return min(total, size * int(np.count_nonzero(written(group)))), total
    except Exception:  # whatever zarr makes of a foreign file
        was = path if path.exists() else f"{path} (not there)"
        raise UserError("DIR", "the folder of a tuning, or the store of a sweep", was) from None


def discard(path: Path) -> None:
    """Remove a store, whatever it was made with, and nothing but a store.

    Raises:
        UserError: no store of a sweep, or one that another process works in.
    """
    try:
        known = FINGERPRINT in read_json(path / "zarr.json")["attributes"]
    except (KeyError, TypeError, ValueError):
        known = False
    if not known:
        raise UserError("out", "the store of a sweep where --overwrite is given", path)
    with locked_folder(path / "status", "out", ".lock-0"):
        shutil.rmtree(path)


def open_store(path: Path, contents: Contents) -> SweepStore:
    """The store at a path, to go on with.

    Raises:
        UserError: no store, or one made by other settings, with the first difference.
    """
    group = _group(path)
    was, now = _flat({name: group.attrs[name] for name in contents.settings}), _flat(contents.settings)
    for name in sorted(was.keys() | now.keys()):
        if was.get(name) != now.get(name):
            raise UserError(name, f"{_shown(was.get(name))}, as {path} was made with", _shown(now.get(name)))
    return SweepStore(group, contents, path, inspect(group, batched(group), contents.batch_size))


def open_sweep(path: str | Path) -> xarray.Dataset:
    """The data set of a store, read when it is used.

    Raises:
        UserError: there is no sweep's store at the path.
    """
    place = resolve_path(path, "store")
    group = _group(place)
    try:
        return _opened(group, inspect(group, batched(group), int(str(group.attrs["batch"]))))
    except Exception as error:  # whatever zarr and xarray make of a damaged file
        raise UserError("store", "the store of a sweep", f"{place} ({error})") from None


def values(data: xarray.DataArray) -> np.ndarray:
    """The values (...) of a variable of a store, all read now; what cannot be read is NaN or -1."""
    try:
        return data.values
    except (OSError, RuntimeError, ValueError):
        size = data.encoding["chunks"][0]
        nothing = -1 if data.dtype.kind == "i" else np.nan
        return np.concatenate([_readable(data[i : i + size], nothing) for i in range(0, len(data), size)])


def _readable(data: xarray.DataArray, nothing: float) -> np.ndarray:
    try:
        return data.values
    except (OSError, RuntimeError, ValueError):
        return np.full(data.shape, nothing, data.dtype)


def scenario_of(data: xarray.Dataset) -> Scenario:
    """The scenario that a data set's samples vary."""
    return validate(Scenario, tomllib.loads(data.attrs["scenario"]))


def chunk_file(path: Path, name: str, batch: int, dimensions: int) -> Path:
    """File in which zarr keeps the chunk of a batch."""
    return path.joinpath(name, "c", str(batch), *["0"] * (dimensions - 1))


def _opened(group: zarr.Group, batches: Batches) -> xarray.Dataset:
    import xarray

    from coopmm_jax.sweeps.data import SweepData  # imports xarray

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Object at .* is not recognized")  # what a file manager leaves in a folder
        stored = xarray.open_zarr(group.store, consolidated=False, chunks=None, drop_variables=[CHECKSUMS, SAMPLE])
    numbers = {SAMPLE: (SAMPLE, np.arange(stored.sizes[SAMPLE]), group[SAMPLE].attrs.asdict())}
    data = SweepData(stored.data_vars, {**stored.coords, **numbers}, stored.attrs)
    status = values(data.status)
    status[~np.repeat(batches.whole, cast(int, group.attrs["batch"]))[: len(status)]] = -1
    data["status"] = data.status.copy(data=status)
    # zarr lists arrays in any order; what every sample has comes first, for whoever looks at the data set.
    data = data[[*BY_SAMPLE, *sorted(set(map(str, data.data_vars)) - set(BY_SAMPLE))]]
    data.attrs["damaged"] = json.dumps(batches.damaged)
    return data


def _group(path: Path) -> zarr.Group:
    """The group at a path, all its arrays of the length it is to have.

    Raises:
        UserError: no store of a sweep, or one whose settings or coordinates are not as they were written.
    """
    writable = os.access(path, os.W_OK)
    try:
        group = zarr.open_group(LocalStore(path), mode="r+" if writable else "r", use_consolidated=False)
        settings = dict(group.attrs)
        coordinates = {name: np.asarray(cast(zarr.Array, group[name])[:]) for name in COORDINATES}
        if settings.get(FINGERPRINT) == fingerprint(settings, coordinates):
            check_plugins(json.loads(str(settings["versions"])), "store", path)
            if writable:
                enlarge(group)
            return group
        reason = "another zarr group, of an older version, or with damaged settings or coordinates"
    except UserError:
        raise
    except FileNotFoundError:
        reason = "not a store" if path.exists() else "not there"
    except Exception as error:  # whatever zarr makes of a damaged or foreign file
        reason = str(error)
    raise UserError("store", "the store of a sweep", f"{path} ({reason})")


def _flat(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Settings by dotted name; those of the scenario by the names the user knows."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        if name == "scenario" and not prefix:
            flat |= _flat(tomllib.loads(value), "")
        elif name == "versions" and not prefix:
            flat |= _flat(json.loads(value), "versions.")
        elif isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _shown(value: Any) -> str:
    return "left out" if value is None else str(value)
