"""Contents of a sweep's store, the empty store that it begins as, and its growth."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple, cast

import numpy as np
import zarr
from zarr.codecs import ZstdCodec
from zarr.storage import LocalStore

from coopmm_jax.sweeps.wholeness import CHECKSUMS, FINGERPRINT, fingerprint

BY_SAMPLE = ("parameters", "metrics", "status", "status_time")
SAMPLE = "sample"  # a coordinate too, which grows with the store
COORDINATES = (*(f"{dim}{what}" for dim in ("parameter", "metric") for what in ("", "_unit", "_meaning")), "t")

_NUMBERS = 4096  # of samples in one file, at least


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
    def batch_size(self) -> int:
        """Samples of a batch."""
        return self.settings["batch"]

    def kept(self, samples: int) -> int:
        """Number of samples that have series, in a sweep of so many."""
        return min(self.settings["keep"], samples)


def build(store: Any, contents: Contents, samples: int) -> zarr.Group:
    """An empty store with room for so many samples."""
    texts = dict(zip(COORDINATES, (*contents.parameters, *contents.metrics)))
    labels = " ".join(name for name in texts if "_" in name)
    attributes = contents.settings | {"series": " ".join(contents.series.names), "coordinates": labels}
    attributes[FINGERPRINT] = fingerprint(attributes, texts | {"t": contents.times})
    group = zarr.create_group(store, attributes=attributes)
    for name, text in texts.items():
        dim = name.partition("_")[0]
        group.create_array(name, data=np.array(text, np.dtypes.StringDType()), dimension_names=(dim,))
    times: dict[str, Any] = {"units": "s", "long_name": "time"}
    group.create_array("t", data=contents.times, dimension_names=("t",), attributes=times)
    about: dict[str, Any] = {"long_name": "number of a sample"}
    numbers = {"data": np.arange(samples), "chunks": (max(samples, _NUMBERS),), "attributes": about}
    group.create_array(SAMPLE, dimension_names=(SAMPLE,), **numbers)
    for name, shape, array in _arrays(contents, samples):
        chunks = (contents.batch_size, *shape[1:])
        group.create_array(name, shape=shape, chunks=chunks, compressors=ZstdCodec(checksum=True), **array)
    about = {"dtype": "uint64", "fill_value": 0, "dimension_names": ("batch",), "attributes": {"samples": samples}}
    group.create_array(CHECKSUMS, shape=(-(-samples // contents.batch_size),), chunks=(1,), **about)
    return group


def room(group: zarr.Group) -> int:
    """Number of samples that a store is to have."""
    return int(str(cast(zarr.Array, group[CHECKSUMS]).attrs["samples"]))


def batched(group: zarr.Group) -> dict[str, zarr.Array]:
    """Arrays (N, ...) that are written batch by batch, by name."""
    with zarr.config.set({"array.write_empty_chunks": True}):  # else a batch of nothing but fill values has no file
        return {name: cast(zarr.Array, group[name]) for name in (*BY_SAMPLE, *series(group))}


def enlarge(group: zarr.Group) -> None:
    """Give every array the length that ``room`` says."""
    samples, settings = room(group), cast(dict[str, int], dict(group.attrs))
    lengths = dict.fromkeys(BY_SAMPLE, samples) | dict.fromkeys(series(group), min(settings["keep"], samples))
    grown = False
    for name, length in (lengths | {SAMPLE: samples, CHECKSUMS: -(-samples // settings["batch"])}).items():
        array = cast(zarr.Array, group[name])
        if array.shape[0] < length:
            array.resize((length, *array.shape[1:]))
            grown = True
    numbers = cast(zarr.Array, group[SAMPLE])
    if grown or numbers[-1] != samples - 1:  # or what made it larger was killed before it had written these
        consolidate(group)
        numbers[:] = np.arange(samples)


def consolidate(group: zarr.Group) -> None:
    """Keep a copy of all descriptions in one file, from which others than this module open a store at once."""
    if isinstance(group.store, LocalStore):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the copy is not in zarr's specification; our locks are no arrays
            zarr.consolidate_metadata(group.store)


def series(group: zarr.Group) -> list[str]:
    """Names of the series that a store keeps."""
    return str(group.attrs["series"]).split()


def _arrays(contents: Contents, samples: int) -> Iterator[tuple[str, tuple[int, ...], dict[str, Any]]]:
    """Name, shape and description of everything that is written batch by batch."""
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
