"""Too large and too long is refused before anything starts, in one line that says how much and what to change."""

import socket
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from coopmm_jax import memory
from coopmm_jax.cli import main
from coopmm_jax.errors import Notice, UserError
from coopmm_jax.memory import check_memory, free_memory
from coopmm_jax.sweeps import rendezvous


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            "simulate paper --simulation.duration 1e6 --simulation.step 1e-4",
            "simulation.duration: must be less than 21",
        ),
        ("simulate paper --simulation.duration 1e5", "simulation.record_every: must be larger, or simulation.duration"),
        ("sweep sensed --batch 10000000 --keep 10000000", "batch: must be smaller, or keep 0 (it takes "),
        ("sweep sensed --batch 10000000", "batch: must be smaller (it takes "),
        ("tune sensed --tuning.starts 1000000000000", "tuning.starts: must be less than 2147483648, was 1000000000000"),
        ("tune sensed --tuning.starts 1000000000", "tuning.starts: must be smaller (it takes "),
        ("tune sensed --tuning.test-samples 1000000000", "tuning.test_samples: must be smaller (it takes "),
        ("tune sensed --pareto 1000000000", "--pareto: must be from 2 to 1000 weightings, was 1000000000"),
        ("compare scenario scenario --scenario sensed --samples 1000000000", "--samples: must be smaller (it takes "),
        ("falsify sensed --starts 1000000000 --rollouts 2000000000", "starts: must be smaller (it takes "),
        ("falsify sensed --compare-random 1000000000", "--compare-random: must be smaller (it takes "),
        (
            "animate paper --out x.gif --speed 1e-12",
            "speed: must be larger, or fps or the duration smaller (at most 10",
        ),
        (
            "animate paper --out x.gif --speed 5e-324",
            "speed: must be larger, or fps or the duration smaller (at most 1",
        ),
        ("animate paper --out x.gif --speed 0.01", "speed: must be larger, or fps or the duration smaller (it takes "),
        ("animate paper --out x.gif --fps 1e-300", "fps: must be from 0.01 to 50 frames per second, was 1e-300"),
    ],
)
def test_too_much_is_refused_at_once(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(memory, "free_memory", lambda: 20e9)
    began = time.monotonic()
    assert main(arguments.split()) == 2
    assert time.monotonic() - began < 10.0
    err = capsys.readouterr().err
    assert err.startswith(f"coopmm: error: {message}")
    assert err.count("\n") == 1
    assert "it takes" not in err or "GB of memory, 20 GB are free)" in err
    assert list(tmp_path.iterdir()) == []


def test_memory_is_asked_of_the_system():
    assert 1e8 < free_memory() < 1e15
    check_memory(0.5 * free_memory(), "x", "smaller", 1)
    with pytest.raises(UserError, match=r"^x: must be smaller \(it takes .* GB of memory, .* GB are free\), was 1$"):
        check_memory(2.0 * free_memory(), "x", "smaller", 1)


@pytest.mark.parametrize(
    "coordinator", ["nonsense:port:x", "nonsense", "localhost:0", "localhost:99999", ":80", "no such host.invalid:80"]
)
def test_a_coordinator_that_cannot_be_is_refused(coordinator, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    sweep = ["sweep", "sensed", "--rank", "1", "--size", "2", "--coordinator", coordinator]
    assert main(sweep) == 2
    assert capsys.readouterr().err.startswith("coopmm: error: --coordinator: must be HOST:PORT, with a port from 1 to")


@pytest.fixture
def port(monkeypatch):
    monkeypatch.setattr(rendezvous, "PATIENCE", 0.5)
    with socket.create_server(("", 0)) as free:
        number = free.getsockname()[1]
    return number


@pytest.mark.parametrize("rank", [0, 1])
def test_a_process_that_waits_in_vain_says_so(rank, port):
    with (
        pytest.warns(Notice, match=r"^waiting up to 0\.5 s for "),
        pytest.raises(UserError, match=r"^--coordinator: must be where all 2 processes meet within 0\.5 s, was local"),
    ):
        rendezvous.meet(f"localhost:{port}", 2, rank)


def test_processes_meet(port, monkeypatch):
    monkeypatch.setattr(rendezvous, "PATIENCE", 20.0)
    with ThreadPoolExecutor(3) as pool, pytest.warns(Notice):
        met = list(pool.map(lambda rank: rendezvous.meet(f"localhost:{port}", 3, rank), (2, 1, 0)))
    assert len(met) == 3
