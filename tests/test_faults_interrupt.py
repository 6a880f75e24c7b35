"""Signals end a command at once, wherever it is, and leave nothing unfinished behind."""

import os
import signal
import subprocess
import sys
import time

import pytest

ENDINGS = {signal.SIGINT: (130, "coopmm: interrupted\n"), signal.SIGTERM: (143, "coopmm: terminated\n")}


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """Signal -> how a command in the midst of XLA ended by it: exit code, stderr, seconds, files left."""
    running, began, found = {}, {}, {}
    for number in ENDINGS:
        folder = tmp_path_factory.mktemp(number.name)
        command = [sys.executable, "-m", "tests.interrupt_worker", "simulate", "paper", "--out", str(folder / "run")]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        process = subprocess.Popen(command, env=os.environ | {"COOPMM_CACHE_DIR": str(folder / "cache")}, **pipes)
        running[number] = process, folder
    try:
        for number, (process, folder) in running.items():
            assert process.stdout.readline() == "computing\n"
            assert any(path.suffix == ".partial" for path in folder.iterdir())
            began[number] = time.monotonic()
            process.send_signal(number)
        for number, (process, folder) in running.items():
            _, err = process.communicate(timeout=20)
            seconds = time.monotonic() - began[number]
            left = sorted(path.name for path in folder.iterdir() if path.name != "cache")
            found[number] = process.returncode, err, seconds, left
    finally:
        for process, _ in running.values():
            process.kill()
    return found


@pytest.mark.parametrize("number", ENDINGS)
def test_a_signal_ends_what_waits_for_xla(number, stopped):
    code, said, seconds, left = stopped[number]
    assert (code, said) == ENDINGS[number]
    assert seconds < 2.0
    assert left == []
