"""Store of a sweep: a zarr group that xarray opens, written batch by batch by any number of processes.

A chunk holds one batch, so no two writers share a file, and each file appears whole or not at all: whatever kills a
process, the batches whose files all exist are complete.

    group attributes   scenario (TOML), sampling, tile, keep, versions
    parameters         (sample, parameter)   drawn values, in the units of coordinate parameter_unit
    metrics            (sample, metric)      in the units of coordinate metric_unit
    status             (sample)              code of ``Status``; -1: not computed yet
    status_time        (sample)              of a failure [s]
    contact_force ...  (kept, t)             series of the first samples, see ``measure.SERIES``
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
import zarr
from zarr.codecs import ZstdCodec
from zarr.storage import LocalStore, MemoryStore

from coopmm_jax.errors import UserError
from coopmm_jax.files import hidden_folder, locked_folder, resolve_path
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.validation import validate

if TYPE_CHECKING:
    import xarray

_BY_SAMPLE = ("parameters", "metrics", "status", "status_time")


class Labels(NamedTuple):
    """Names, units and meanings along one dimension."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    meanings: tuple[str, ...]


class Contents(NamedTuple):
    """Contents of a store; two sweeps with equal settings share one."""

    settings: dict[str, Any]  # the group's attributes
    parameters: Labels
    metrics: Labels
    series: Labels
    times: np.ndarray  # of the series [s]

    @property
    def tile(self) -> int:
        """Samples of a batch."""
        return self.settings["tile"]

    def kept(self, samples: int) -> int:
        """Number of samples that have series, in a sweep of so many."""
        return min(self.settings["keep"], samples)


class SweepStore:
    """An open store; ``create``, ``open_store`` and ``in_memory`` make one."""

    def __init__(self, group: zarr.Group, contents: Contents, path: Path | None):
        self.path, self._contents = path, contents
        names = [*_BY_SAMPLE, *contents.series.names]
        with zarr.config.set({"array.write_empty_chunks": True}):  # else a tile of nothing but fill values has no file
            self._arrays = {name: cast(zarr.Array, group[name]) for name in names}
        self._group = group

    @property
    def samples(self) -> int:
        """Number of samples the store has room for."""
        return self._arrays["status"].shape[0]

    @property
    def tiles(self) -> int:
        """Number of tiles of these samples."""
        return -(-self.samples // self._contents.tile)

    def locked(self, rank: int) -> AbstractContextManager[None]:
        """Keep other processes of the same rank out of the store.

        Raises:
            UserError: on entering, if there is one.
        """
        if self.path is None:
            return nullcontext()
        return locked_folder(self.path / "status", "out", f".lock-{rank}")  # zarr would take it for data in a group

    def done(self, tile: int) -> bool:
        """True if a batch is complete."""
        return self.path is not None and all(path.exists() for path in self._files(self.path, tile))

    def write(self, tile: int, values: Mapping[str, np.ndarray]) -> None:
        """Write one batch: arrays (B, ...) by name, the last of its B samples perhaps beyond the sweep."""
        size = self._contents.tile
        for name, rows in values.items():
            array = self._arrays[name]
            window = slice(tile * size, min((tile + 1) * size, array.shape[0]))
            array[window] = rows[: window.stop - window.start]

    def grow(self, samples: int) -> None:
        """Make room for more samples. A last batch that was cut short is to be computed again.

        Raises:
            UserError: the store has more samples already.
        """
        if samples < self.samples:
            raise UserError("samples", f"at least {self.samples}, as {self.path} has", samples)
        tile, cut = divmod(self.samples, self._contents.tile)
        if samples > self.samples:
            for path in self._files(self.path, tile) if cut and self.path is not None else ():
                path.unlink(missing_ok=True)
            for name, array in self._arrays.items():
                rows = samples if name in _BY_SAMPLE else self._contents.kept(samples)
                array.resize((rows, *array.shape[1:]))

    def dataset(self) -> xarray.Dataset:
        """Everything written so far, read when it is used."""
        return _opened(self._group.store)

    def _files(self, folder: Path, tile: int) -> list[Path]:
        keeping = tile * self._contents.tile < self._contents.kept(self.samples)
        names = [name for name in self._arrays if name in _BY_SAMPLE or keeping]
        return [chunk_file(folder, name, tile, self._arrays[name].ndim) for name in names]


def in_memory(contents: Contents, samples: int) -> SweepStore:
    """A store that lives as long as the process."""
    return SweepStore(_build(MemoryStore(), contents, samples), contents, None)


def create(path: Path, contents: Contents, samples: int) -> SweepStore:
    """A new store at a path where nothing is; all of its files appear there at once.

    Raises:
        UserError: the path exists, or cannot be written.
    """
    if os.path.lexists(path):
        raise UserError("out", "a path where nothing is, or a sweep's store to --resume", path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with hidden_folder(path.parent, path.name) as hidden:
            _build(LocalStore(hidden), contents, samples)
            hidden.rename(path)
    except OSError as error:
        raise UserError("out", "a place that can be written", f"{path} ({error.strerror})") from None
    return open_store(path, contents)


def open_store(path: Path, contents: Contents) -> SweepStore:
    """The store at a path, to go on with.

    Raises:
        UserError: no store, or one made by other settings, with the first difference.
    """
    group = _group(path)
    was, now = _flat(dict(group.attrs)), _flat(contents.settings)
    for name in sorted(was.keys() | now.keys()):
        if was.get(name) != now.get(name):
            raise UserError(name, f"{_shown(was.get(name))}, as {path} was made with", _shown(now.get(name)))
    return SweepStore(group, contents, path)


def read_store(path: str | Path) -> xarray.Dataset:
    """The data set of a store, read when it is used.

    Raises:
        UserError: there is no sweep's store at the path.
    """
    return _opened(_group(resolve_path(path, "store")).store)


def values(data: xarray.DataArray) -> np.ndarray:
    """The values (...) of a variable of a store, all read now.

    Raises:
        UserError: a chunk is corrupt.
    """
    try:
        return data.values
    except (RuntimeError, ValueError):
        must = "readable (delete the file, and sweep --resume computes its tile again)"
        raise UserError(f"{data.name}/c/{_corrupt_tile(data)} of the store", must, "corrupt") from None


def scenario_of(data: xarray.Dataset) -> Scenario:
    """The scenario that a data set's samples vary."""
    return validate(Scenario, tomllib.loads(data.attrs["scenario"]))


def chunk_file(path: Path, name: str, tile: int, dimensions: int) -> Path:
    """File in which zarr keeps the chunk of a batch."""
    return path.joinpath(name, "c", str(tile), *["0"] * (dimensions - 1))


def _corrupt_tile(data: xarray.DataArray) -> int | str:
    size = data.encoding["chunks"][0]
    for start in range(0, len(data), size):
        try:
            data[start : start + size].values  # noqa: B018 - reads the chunk
        except (RuntimeError, ValueError):
            return start // size
    return "?"


def _opened(store: Any) -> xarray.Dataset:
    import xarray

    data = xarray.open_zarr(store, consolidated=False, chunks=None)
    # zarr lists arrays in any order; what every sample has comes first, for whoever looks at the data set.
    return data[[*_BY_SAMPLE, *sorted(set(map(str, data.data_vars)) - set(_BY_SAMPLE))]]


def _group(path: Path) -> zarr.Group:
    try:
        group = zarr.open_group(LocalStore(path), mode="r+" if os.access(path, os.W_OK) else "r")
        if "sampling" in group.attrs:
            return group
        reason = "another zarr group"
    except FileNotFoundError:
        reason = "not there"
    except (OSError, ValueError, KeyError) as error:
        reason = str(error)
    raise UserError("store", "the store of a sweep", f"{path} ({reason})")


def _build(store: Any, contents: Contents, samples: int) -> zarr.Group:
    coordinates = [f"{dim}_{what}" for dim in ("parameter", "metric") for what in ("unit", "meaning")]
    group = zarr.create_group(store, attributes=contents.settings | {"coordinates": " ".join(coordinates)})
    for dim, labels in (("parameter", contents.parameters), ("metric", contents.metrics)):
        for name, texts in zip((dim, f"{dim}_unit", f"{dim}_meaning"), labels, strict=True):
            group.create_array(name, data=np.array(texts, np.dtypes.StringDType()), dimension_names=(dim,))
    times: dict[str, Any] = {"units": "s", "long_name": "time"}
    group.create_array("t", data=contents.times, dimension_names=("t",), attributes=times)
    for name, shape, array in _arrays(contents, samples):
        chunks = (contents.tile, *shape[1:])
        group.create_array(name, shape=shape, chunks=chunks, compressors=ZstdCodec(checksum=True), **array)
    return group


def _arrays(contents: Contents, samples: int) -> Iterator[tuple[str, tuple[int, ...], dict[str, Any]]]:
    """Name, shape and description of everything that is written tile by tile."""
    reals = {"dtype": "float64", "fill_value": np.nan}
    for name, labels in (("parameters", contents.parameters), ("metrics", contents.metrics)):
        yield name, (samples, len(labels.names)), reals | {"dimension_names": ("sample", name[:-1])}
    codes = {"dtype": "int8", "fill_value": -1, "dimension_names": ("sample",)}
    yield "status", (samples,), codes | {"attributes": {"long_name": "code of Status; -1: not computed yet"}}
    about = {"units": "s", "long_name": "time of failure"}
    yield "status_time", (samples,), reals | {"dimension_names": ("sample",), "attributes": about}
    for name, unit, meaning in zip(*contents.series, strict=True):
        about = {"units": unit, "long_name": meaning}
        shape = (contents.kept(samples), len(contents.times))
        yield name, shape, reals | {"dimension_names": ("kept", "t"), "attributes": about}


def _flat(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Settings by dotted name; those of the scenario by the names the user knows."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        if name == "scenario" and not prefix:
            flat |= _flat(tomllib.loads(value), "")
        elif isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        elif name != "coordinates":
            flat[f"{prefix}{name}"] = value
    return flat


def _shown(value: Any) -> str:
    return "left out" if value is None else str(value)
