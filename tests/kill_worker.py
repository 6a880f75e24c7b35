"""A tuning run around closed-form costs, in a process that may kill itself: run by test_tuning.py.

    python -m tests.kill_worker FOLDER [ITERATION to be killed at]

Goes on with the folder's run where it has one.
"""

import os
import signal
import sys
from pathlib import Path

import pytest

import tuning
from tests.closed_costs import replace_rollouts, scenario
from tests.workers import start_worker
from tuning.studies import state


def main():
    """Tune; with an iteration, die before its line of history is written."""
    start_worker()
    folder, killed = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else None
    write = state.append_history

    def append_history(folder, row):
        if row.iteration == killed:
            os.kill(os.getpid(), signal.SIGKILL)
        write(folder, row)

    with pytest.MonkeyPatch.context() as patch:
        replace_rollouts(patch)
        patch.setattr(state, "append_history", append_history)
        tuning.tune(scenario(), out=folder, resume=(folder / state.NAME).exists())


if __name__ == "__main__":
    main()
