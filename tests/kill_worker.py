"""A tuning run around closed-form costs, in a process that kills itself: run by test_tuning.py.

    python -m tests.kill_worker FOLDER EARLIER ITERATION

EARLIER is what a kill at iteration 0 would have left of FOLDER.
"""

import os
import shutil
import signal
import sys
from pathlib import Path

import pytest

import tuning
from tests.closed_costs import replace_rollouts, scenario
from tests.workers import start_worker
from tuning.studies import state


def main():
    """Tune, and die before the iteration's line of history is written."""
    start_worker()
    folder, earlier, killed = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    write = state.append_history

    def append_history(folder, row):
        if row.iteration == 0:
            shutil.copytree(folder, earlier)
        if row.iteration == killed:
            os.kill(os.getpid(), signal.SIGKILL)
        write(folder, row)

    with pytest.MonkeyPatch.context() as patch:
        replace_rollouts(patch)
        patch.setattr(state, "append_history", append_history)
        tuning.tune(scenario(), out=folder)


if __name__ == "__main__":
    main()
