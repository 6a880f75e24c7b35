"""Size of a sweep's batches, and the memory that they take."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from coopmm_jax.files import read_json
from coopmm_jax.memory import check_memory
from coopmm_jax.scenario.variation import Variation
from coopmm_jax.sweeps.batch import elsewhere, place
from coopmm_jax.sweeps.contents import Contents
from coopmm_jax.sweeps.devices import OF_A_CORE, free_memory_of, on_its_own, suitable_batch
from coopmm_jax.sweeps.measure import Horizon, kept_of_every_sample

# Memory at the peak [byte], measured over batches of 4096 and 16384: of a rollout, of each point that it keeps, of each
# number that sentences need of every sample (30 on a processor, 44 on a GPU, which copies them once more).
_PER_ROLLOUT, _PER_POINT, _PER_NUMBER = 6000.0, 1100.0, 48.0


def memory_of_rollout(variation: Variation, horizon: Horizon) -> float:
    """Memory of one rollout without its series [byte]."""
    scenario = variation.scenario
    sentences = scenario.requirements.sentences()
    kept = (
        kept_of_every_sample(variation.structure(), horizon, scenario.parameters(), sentences) if sentences.forms else 0
    )
    return _PER_ROLLOUT + _PER_NUMBER * kept * horizon.steps


def batch_size(begun: Path | None, samples: int, per_rollout: float, processes: int) -> int:
    """Size of batches where none is asked for: that of a store to go on with, or what suits the devices.

    Args:
        begun: path where that store may be.
        samples: of the sweep.
        per_rollout: memory [byte].
        processes: that share the sweep.
    """
    known = _batch_of(begun) if begun is not None else None
    suits = OF_A_CORE if elsewhere.get() else suitable_batch(samples, per_rollout, processes)
    return known or suits


def _batch_of(path: Path) -> int | None:
    """Size of the batches of the store at a path; None if there is none that can be read."""
    try:
        return int(read_json(path / "zarr.json")["attributes"]["batch"])
    except (KeyError, TypeError, ValueError):
        return None


def traced_together(contents: Contents) -> int:
    """Samples whose series come from one call: a core's batch, or a power of two that holds all that are kept."""
    return min(contents.batch_size, max(OF_A_CORE, 1 << (contents.settings["keep"] - 1).bit_length()))


def check_sizes(contents: Contents, places: Sequence[Any], samples: int, per_rollout: float, stored: bool) -> None:
    """Refuse batches, or a sweep without a store, that do not fit into memory.

    Args:
        contents: of the sweep.
        places: slots of the batches.
        samples: of the sweep.
        per_rollout: memory without series [byte].
        stored: whether there is a store.

    Raises:
        UserError: they do not.
    """
    batch, own = contents.batch_size, on_its_own(places[0])
    points = len(contents.times) if contents.kept(samples) else 0
    together = traced_together(contents)
    series = _PER_POINT * points * together
    must = "smaller, or keep 0" if series > batch * per_rollout else "smaller"
    beside = series if on_its_own(place(places[0], together)) else 0.0
    if own:
        for device in set(places):
            needed = places.count(device) * (batch * per_rollout + beside)
            check_memory(needed, "batch", must, batch, free_memory_of(device), f"the memory of {device.device_kind}")
    host = batch * (_PER_ROLLOUT if own else per_rollout) + series - beside
    check_memory(len(places) * host, "batch", must, batch)
    if not stored:
        columns = len(contents.parameters.names) + len(contents.metrics.names) + 2
        kept = contents.kept(samples) * points * len(contents.series.names)
        check_memory(8.0 * (samples * columns + kept), "samples", "fewer, or out given", samples)
