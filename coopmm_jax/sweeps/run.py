"""Simulate many plausible samples of a scenario and keep their metrics.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> short = load_scenario("sensed", simulation={"duration": 0.04})
>>> sweep(short, samples=3, keep=0, batch=32).metrics.sel(metric="force_min").shape
(3,)
"""

from __future__ import annotations

import contextlib
import json
import operator
import shutil
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from tqdm import tqdm

from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path
from coopmm_jax.kinds.software import versions
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.runtime import xla_options
from coopmm_jax.scenario import plausible
from coopmm_jax.scenario.feasible import check_reference
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.variation import Variation, vary
from coopmm_jax.sweeps import measure
from coopmm_jax.sweeps import store as sweep_store
from coopmm_jax.sweeps.batch import Device, concurrently, place, slots
from coopmm_jax.sweeps.contents import Contents, Labels
from coopmm_jax.sweeps.devices import on_its_own
from coopmm_jax.sweeps.engine import carried_by, naming
from coopmm_jax.sweeps.measure import SERIES, Horizon
from coopmm_jax.sweeps.processes import Share
from coopmm_jax.sweeps.sizes import batch_size, check_sizes, memory_of_rollout, traced_together
from coopmm_jax.sweeps.store import SweepStore
from coopmm_jax.temporal_logic.sentence import Sentences

if TYPE_CHECKING:
    import xarray

SAMPLES = 1000
KEEP = 64
LIMIT = 2**24  # samples; a noise stream's number is exact in float32 too
ALONE = Share()
_PATIENCE = 300.0  # [s], for the process of rank 0 to make the store


def sweep(
    scenario: Scenario | str | Path,
    samples: int | None = None,
    seed: int | None = None,
    sampling: str = "independent",
    out: str | Path | None = None,
    resume: bool = False,
    keep: int = KEEP,
    batch: int | None = None,
    share: Share = ALONE,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> xarray.Dataset:
    """Simulate samples of a scenario with [uncertainty], on all cores, or on the GPUs that JAX finds.

    A sample's bits depend on the scenario, the seed, its index and the device alone: not on how many samples there are,
    on interruptions, or on how many processes share the work. A GPU's are those of a processor but for rounding.

    Args:
        scenario: a scenario, or the name or path of one.
        samples: number of samples; by default 1000, or as many as the store to be resumed has.
        seed: of everything random; by default the scenario's.
        sampling: "independent", or "sobol" for scrambled Sobol points.
        out: path of a zarr store, written batch by batch; without it everything stays in memory.
        resume: go on with the store at ``out``, if there is one, and make it larger if ``samples`` says so.
        keep: number of samples, the first ones, whose time series are kept.
        batch: samples in one call of the compiled function; by default that of the store to be resumed, or what suits
            the device: 64 on a processor, up to 65,536 on a GPU, which is used from 4,096 on.
        share: this process's part of the work.
        overwrite: begin anew where there is a store at ``out``.
        executor: whose workers run the batches, see ``sweeps/engine.py``; left out, this process does.

    Returns:
        Parameters, metrics and status by sample, read from the store when they are used.

    Raises:
        UserError: settings that cannot be used, nothing that varies, a store made by other settings, or one that cannot
            be written.
    """
    if overwrite and (resume or share != ALONE):
        raise UserError("--overwrite", "left out with --resume, and where several processes share the store", "given")
    scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    if seed is not None:
        scenario = scenario.with_overrides({"simulation.seed": seed})
    samples = None if samples is None else _count("samples", samples, 1)
    keep, batch = _count("keep", keep, 0), None if batch is None else _count("batch", batch, 1)
    variation = vary(scenario)
    if not variation.numbers:
        raise UserError("uncertainty", "a section that names what varies", "empty")
    points = sampler(sampling, scenario.simulation.seed, len(variation.draws))
    path = None if out is None else resolve_path(out, "out")
    begun = path if resume or share.rank > 0 else None
    per_rollout = memory_of_rollout(variation, _horizon(scenario))
    with carried_by(executor):
        batch = batch or batch_size(begun, samples or SAMPLES, per_rollout, share.size)
        places = slots(batch)
    contents = _contents(variation, sampling, keep, batch, places[0])
    check_sizes(contents, places, samples or SAMPLES, per_rollout, stored=path is not None)
    plausible.warn_of(scenario)
    check_reference(scenario)
    if overwrite and path is not None and path.exists():
        sweep_store.discard(path)
    fresh = path is not None and not path.exists() and share == ALONE
    store = _store(contents, path, samples, resume, share)
    with _going_again_if_empty(store, fresh), store.locked(share.rank):
        if share.rank == 0:
            with _writing(store):
                store.grow(samples or store.samples)
        _fill(store, variation, points, contents, share, places)
    return store.dataset()


def _count(name: str, value: Any, least: int) -> int:
    """A number of samples as Python's own, which a store can keep, whatever kind of whole number it is."""
    try:
        count = operator.index(value)
    except TypeError:
        raise UserError(name, "a whole number", value) from None
    if not least <= count <= LIMIT:
        raise UserError(name, f"from {least} to {LIMIT}", count)
    return count


@contextlib.contextmanager
def _going_again_if_empty(store: SweepStore, fresh: bool) -> Iterator[None]:
    """Remove a new store without a whole batch when something goes wrong, so that the same command can begin again."""
    try:
        yield
    except BaseException:
        if fresh and store.path is not None and not any(map(store.done, range(store.batches))):
            shutil.rmtree(store.path, ignore_errors=True)
        raise


def _contents(variation: Variation, sampling: str, keep: int, batch: int, device: Device) -> Contents:
    """Contents of this sweep's store, and all that its bits depend on."""
    scenario, numbers = variation.scenario, variation.numbers
    software = versions() | {"xla_flags": xla_options()}
    if on_its_own(device):
        software["device"] = device.device_kind
    return Contents(
        settings={
            "scenario": scenario.to_toml(),
            "sampling": sampling,
            "batch": batch,
            "keep": keep,
            "versions": json.dumps(software),
        },
        parameters=Labels(*zip(*((n.name, n.unit, n.meaning) for n in numbers), strict=True)),
        metrics=Labels(
            *zip(*((m.name, m.unit, m.meaning) for m in scenario.requirements.metrics().values()), strict=True)
        ),
        series=Labels(tuple(SERIES), *zip(*SERIES.values(), strict=True)),
        times=_horizon(scenario).times(),
    )


def _horizon(scenario: Scenario) -> Horizon:
    return Horizon(scenario.sample_time, scenario.steps, scenario.simulation.precision)


def _store(contents: Contents, out: Path | None, samples: int | None, resume: bool, share: Share) -> SweepStore:
    """The store to fill: a new one, or an old one, which may have too little room yet."""
    if out is None:
        return sweep_store.in_memory(contents, samples or SAMPLES)
    if share.rank > 0:
        return _appearing_store(contents, out, samples or SAMPLES)
    if not (resume and out.exists()):
        return sweep_store.create(out, contents, samples or SAMPLES)
    return sweep_store.open_store(out, contents)


def _appearing_store(contents: Contents, out: Path, samples: int) -> SweepStore:
    """The store that rank 0 makes, or makes larger."""
    end = time.monotonic() + _PATIENCE
    while time.monotonic() < end:
        if out.exists():
            store = sweep_store.open_store(out, contents)
            if store.samples >= samples:
                return store
        time.sleep(0.2)
    must = f"started together with rank 0, which makes room for {samples} samples in {out}"
    raise UserError("--rank", must, f"alone for {_PATIENCE:g} s")


def _fill(
    store: SweepStore, variation: Variation, points: Any, contents: Contents, share: Share, places: list[Any]
) -> None:
    """Compute and write the batches of this process that are not in the store yet."""
    batches = share.batches(store.batches)
    missing = [batch for batch in batches if not store.done(batch)]
    structure, horizon = variation.structure(), _horizon(variation.scenario)
    sentences, together = variation.scenario.requirements.sentences(), traced_together(contents)

    def indices(batch: int) -> range:
        return range(batch * contents.batch_size, (batch + 1) * contents.batch_size)

    def drawn() -> Iterator[tuple[int, np.ndarray]]:
        for batch in missing:
            yield batch, points(indices(batch))

    def compute(device: Any, item: tuple[int, np.ndarray]) -> None:
        batch, at = item
        parameters = variation.batch(at, indices(batch))
        rows = {"parameters": np.stack(list(variation.values(at).values()), axis=1)}
        kept = contents.kept(store.samples) - indices(batch)[0]
        with naming(f"samples {indices(batch)[0]} to {indices(batch)[-1]}"):
            rows |= _results(structure, horizon, device, parameters, sentences, min(kept, len(at)), together)
        with _writing(store):
            store.write(batch, rows)

    done = (len(batches) - len(missing)) * contents.batch_size
    with tqdm(total=len(batches) * contents.batch_size, initial=done, unit="sample", disable=None) as bar:
        for _ in concurrently(compute, drawn(), places):
            bar.update(contents.batch_size)


def _results(
    structure: Structure,
    horizon: Horizon,
    device: Device,
    parameters: Parameters,
    sentences: Sentences,
    kept: int,
    together: int,
) -> dict[str, np.ndarray]:
    """Metrics and status of a batch by name, and series of its first ``kept`` samples if that is not below one."""
    if kept <= 0:
        return measure.measure(structure, horizon, device, parameters, sentences)._asdict()
    with ThreadPoolExecutor(1) as beside:  # one is compiled while the other is
        series = beside.submit(_series, structure, horizon, device, parameters, kept, together)
        return measure.measure(structure, horizon, device, parameters, sentences)._asdict() | series.result()


def _series(
    structure: Structure, horizon: Horizon, device: Device, parameters: Parameters, count: int, together: int
) -> dict[str, np.ndarray]:
    """Series of the first ``count`` samples of a batch, traced ``together`` at a time: they take much memory."""
    own, parts = place(device, together), []
    for start in range(0, count, together):
        rows = np.minimum(np.arange(start, start + together), count - 1)  # always as many: their bits depend on it
        chosen = jax.tree.map(lambda x, rows=rows: x[rows] if x.shape else x, parameters)
        parts.append(measure.trace(structure, horizon, own, chosen))
    return {name: np.concatenate([part[name] for part in parts]) for name in SERIES}


@contextlib.contextmanager
def _writing(store: SweepStore) -> Iterator[None]:
    """Say in one line where a store cannot be written."""
    try:
        yield
    except OSError as error:
        was = f"{store.path} ({error.strerror}); complete batches are safe, --resume goes on"
        raise UserError("out", "a place with room and permission to write", was) from None
