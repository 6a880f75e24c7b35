"""Contents of a sweep's store, and the empty store that it begins as."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import zarr
from zarr.codecs import ZstdCodec

from coopmm_jax.sweeps.wholeness import CHECKSUMS, FINGERPRINT, fingerprint

BY_SAMPLE = ("parameters", "metrics", "status", "status_time")
COORDINATES = (*(f"{dim}{what}" for dim in ("parameter", "metric") for what in ("", "_unit", "_meaning")), "t")


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
    attributes = contents.settings | {"series": list(contents.series.names), "coordinates": labels}
    attributes[FINGERPRINT] = fingerprint(attributes, texts | {"t": contents.times})
    group = zarr.create_group(store, attributes=attributes)
    for name, text in texts.items():
        dim = name.partition("_")[0]
        group.create_array(name, data=np.array(text, np.dtypes.StringDType()), dimension_names=(dim,))
    times: dict[str, Any] = {"units": "s", "long_name": "time"}
    group.create_array("t", data=contents.times, dimension_names=("t",), attributes=times)
    for name, shape, array in _arrays(contents, samples):
        chunks = (contents.batch_size, *shape[1:])
        group.create_array(name, shape=shape, chunks=chunks, compressors=ZstdCodec(checksum=True), **array)
    batches, room = -(-samples // contents.batch_size), {"samples": samples}
    about = {"dtype": "uint64", "fill_value": 0, "dimension_names": ("batch",), "attributes": room}
    group.create_array(CHECKSUMS, shape=(batches,), chunks=(1,), **about)
    return group


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
