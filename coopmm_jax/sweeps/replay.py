"""Replay of a sweep's sample: a scenario of its own, to look at it closely."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.variation import vary
from coopmm_jax.sweeps import store

if TYPE_CHECKING:
    import xarray


def replay(sweep: xarray.Dataset | str | Path, sample: int) -> Scenario:
    """Scenario of one sample: ``simulate(replay("sweep.zarr", 1234))`` runs it again.

    Args:
        sweep: a sweep's data set, or the path of its store.
        sample: its number, from 0.

    Raises:
        UserError: no such sample, one that has not been computed yet, or no sweep's store.
    """
    data = store.open_sweep(sweep) if isinstance(sweep, str | Path) else sweep
    count = data.sizes["sample"]
    if not 0 <= sample < count:
        raise UserError("sample", f"from 0 to {count - 1}", sample)
    row = data.isel(sample=sample)
    if int(store.values(row.status)) < 0:
        damaged = json.loads(data.attrs.get("damaged", "{}")).get(str(sample // data.attrs["batch"]))
        was = f"{sample} ({damaged})" if damaged else sample
        raise UserError("sample", "one that has been computed (sweep --resume computes the rest)", was)
    drawn = zip(data.parameter.values, store.values(row.parameters), strict=True)
    variation = vary(store.scenario_of(data))
    return variation.sample(sample, {str(name): float(value) for name, value in drawn})
