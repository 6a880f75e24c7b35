"""A GPU beside the processor: which batches it gets, how large they are, and what does not fit into its memory.

Stand-ins have the attributes of JAX's devices that the choice reads.
"""

import json
from types import SimpleNamespace

import jax
import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax import memory
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.variation import vary
from coopmm_jax.sweeps import batch, devices, measure, run, sizes
from tests.sweeps import BATCH

CPU = SimpleNamespace(platform="cpu", device_kind="cpu")


class Gpu(SimpleNamespace):
    platform, device_kind = "gpu", "stand-in"

    def memory_stats(self):
        return {"bytes_limit": self.limit, "bytes_in_use": 1e9}

    def __hash__(self):
        return id(self)


@pytest.fixture
def machine(monkeypatch):
    """Give JAX so many GPUs with so much memory [byte], beside the processor or instead of it."""

    def made(count=1, limit=61e9, processor=True):
        gpus = [Gpu(limit=limit) for _ in range(count)]

        def local_devices(backend=None):
            if backend == "cpu" and not processor:
                raise RuntimeError("Unknown backend cpu")
            return [CPU] if backend == "cpu" else gpus

        monkeypatch.setattr(jax, "local_devices", local_devices)
        return gpus

    return made


def test_small_batches_are_left_to_the_processor(machine):
    (gpu,) = machine()
    assert devices.suited(4095) == [CPU]
    assert devices.suited(4096) == [gpu]
    assert batch.slots(65536) == [gpu, gpu]
    assert set(map(id, batch.slots())) == {id(CPU)}
    assert batch.place(gpu, 64) is CPU
    assert batch.place(gpu, 8192) is gpu


def test_a_gpu_alone_gets_small_batches_too(machine):
    (gpu,) = machine(processor=False)
    assert devices.suited(1) == [gpu]


@pytest.mark.parametrize(
    ("samples", "count", "processes", "size"),
    [
        (4095, 1, 1, 64),
        (4096, 1, 1, 16384),
        (16385, 1, 1, 32768),
        (65536, 1, 1, 65536),
        (65537, 1, 1, 49152),
        (100_000, 1, 1, 65536),
        (1_000_000, 1, 1, 65536),
        (100_000, 4, 1, 32768),
        (100_000, 2, 4, 16384),
    ],
)
def test_a_gpu_gets_few_batches_of_one_size(machine, samples, count, processes, size):
    machine(count)
    assert devices.suitable_batch(samples, 6000.0, processes) == size


@pytest.mark.parametrize(("per_rollout", "size"), [(6e5, 49152), (2e6, 12288), (1e9, 4096)])
def test_batches_are_as_large_as_a_gpu_has_memory(machine, per_rollout, size):
    machine(limit=61e9)
    assert devices.suitable_batch(10**6, per_rollout) == size


def test_a_processor_gets_batches_of_64(monkeypatch):
    monkeypatch.setattr(jax, "local_devices", lambda: [CPU])
    assert sizes.batch_size(None, 10**6, 6000.0, 1) == 64


def test_a_store_is_gone_on_with_in_its_own_batches(sweep, scenario, tmp_path):
    store = tmp_path / "s.zarr"
    before = sweep(8, out=store)
    again = cm.sweep(scenario, out=store, keep=0, resume=True)
    assert again.attrs["batch"] == before.attrs["batch"] == BATCH
    with pytest.raises(UserError, match=r"^batch: must be 8, as .* was made with, was 64$"):
        cm.sweep(scenario, out=store, keep=0, resume=True, batch=64)


def test_a_store_tells_a_gpu_it_was_made_on(scenario):
    variation = vary(scenario)
    (on_gpu, on_cpu) = (run._contents(variation, "sobol", 0, 8, device) for device in (Gpu(limit=1e9), CPU))
    assert json.loads(on_gpu.settings["versions"]) == json.loads(on_cpu.settings["versions"]) | {"device": "stand-in"}


@pytest.mark.parametrize(
    ("size", "keep", "message"),
    [
        (262144, 0, "batch: must be smaller (it takes 3.15 GB of the memory of stand-in, 1 GB are free), was 262144"),
        (
            8192,
            8192,
            "batch: must be smaller, or keep 0 (it takes 1.02 GB of the memory of stand-in, 1 GB are free), wa",
        ),
    ],
)
def test_what_a_gpu_has_no_room_for_is_refused(machine, monkeypatch, scenario, size, keep, message):
    (gpu,) = machine(limit=2e9)
    monkeypatch.setattr(memory, "free_memory", lambda: 20e9)
    contents = run._contents(vary(scenario), "sobol", keep, size, gpu)
    with pytest.raises(UserError) as refused:
        sizes.check_sizes(contents, batch.slots(size), 10**6, 6000.0, stored=True)
    assert str(refused.value).startswith(message)


def test_sentences_that_need_all_samples_count(scenario):
    variation = vary(scenario)
    per_rollout = sizes.memory_of_rollout(variation, run._horizon(scenario))
    assert per_rollout == sizes._PER_ROLLOUT + sizes._PER_NUMBER * scenario.steps  # one of the two needs its signal


def test_memory_that_runs_out_is_one_line(monkeypatch):
    def exhausted(*_):
        raise jax.errors.JaxRuntimeError(text)

    monkeypatch.setattr(batch, "_executable", exhausted)
    program = batch.Program(np.sin, ())
    text = "RESOURCE_EXHAUSTED: Out of memory while trying to allocate 9 bytes. [allocator='x']\nBuffers:\n"
    for call in (batch.run, batch.prepare):
        with pytest.raises(UserError) as told:
            call(program, CPU, (np.zeros(3),))
        must = "batch: must be small enough for the free memory of cpu, was 3 (Out of memory while trying to allocate 9"
        assert str(told.value) == f"{must} bytes.)"
    text = "INTERNAL: something else"
    with pytest.raises(jax.errors.JaxRuntimeError, match="something else"):
        batch.run(program, CPU, (np.zeros(3),))


def test_series_come_from_batches_of_their_own_size(machine, monkeypatch):
    (gpu,) = machine()
    seen = []

    def trace(structure, horizon, device, parameters):
        seen.append((device, len(parameters["own"]), parameters["shared"]))
        return dict.fromkeys(measure.SERIES, parameters["own"][:, None])

    monkeypatch.setattr(measure, "trace", trace)
    parameters = {"own": np.arange(4096.0), "shared": np.array(7.0)}
    found = run._series(None, None, gpu, parameters, 100, 64)
    assert seen == [(CPU, 64, 7.0), (CPU, 64, 7.0)]
    assert all(series[:100, 0].tolist() == list(range(100)) for series in found.values())


@pytest.mark.parametrize(("keep", "together"), [(0, 64), (64, 64), (65, 128), (1000, 1024), (10**6, 16384)])
def test_series_take_few_calls(scenario, keep, together):
    assert sizes.traced_together(run._contents(vary(scenario), "sobol", keep, 16384, CPU)) == together
