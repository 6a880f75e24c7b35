"""Batches that two of Dask's workers carry, one of which is killed; run by test_engine.py in a process of its own.

The folder that it is given has plugin.py; the answer is pickled to answer.pkl.
"""

import logging
import os
import pickle
import signal
import sys
from pathlib import Path

import coopmm_jax as cm
from coopmm_jax.sweeps.dask import connected
from coopmm_jax.sweeps.run import sweep
from tests.workers import start_worker

VARIED = {"plant.masses": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}}
SHORT = {"simulation": {"duration": 0.03}}
BATCH, SAMPLES, KILLED_AT = 16, 192, 5


class Killing:
    """An executor that kills one of its workers when it is given a certain batch."""

    def __init__(self, executor):
        self.executor, self.given, self.killed = executor, 0, []
        self._client = executor._client  # by which the number of workers is known

    def submit(self, function, order):
        self.given += 1
        if self.given == KILLED_AT:
            pids = self._client.run(os.getpid)
            self.killed.append(min(pids.values()))
            os.kill(self.killed[0], signal.SIGKILL)
        return self.executor.submit(function, order)


def main(folder):
    """Sweep of this process alone, and on two workers of which one is killed in the middle."""
    start_worker()
    logging.disable(logging.CRITICAL)  # what Dask says of its killed worker
    cm.load_plugin(folder / "plugin.py")
    scenario = cm.load_scenario("paper", uncertainty=VARIED, disturbance=[{"kind": "knock", "wheel": 5.0}], **SHORT)
    alone = sweep(scenario, SAMPLES, batch=BATCH, keep=0)
    with connected("local:2") as executor:
        killing = Killing(executor)
        shared = sweep(scenario, SAMPLES, batch=BATCH, keep=0, executor=killing)
    answer = {"alone": alone, "shared": shared, "killed": killing.killed, "given": killing.given}
    (folder / "answer.pkl").write_bytes(pickle.dumps(answer))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
