"""Rollouts in a process of their own, which compiles them with the options of the command line, as they are shipped."""

import functools
import pickle
import subprocess
import sys

from tests.programs import Program
from tests.workers import environment, start_worker


def runs_apart(jobs):
    """``Run`` of each of a mapping's (structure, parameters, step, steps), under the same keys."""
    command = [sys.executable, "-m", __name__]
    done = subprocess.run(
        command, input=pickle.dumps(jobs), env=environment(shipped=True), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
    return pickle.loads(done.stdout)


def main():
    """Jobs from the standard input, runs to the standard output."""
    start_worker()
    programs = functools.cache(Program)
    jobs = pickle.load(sys.stdin.buffer)
    pickle.dump({name: programs(structure)(*job) for name, (structure, *job) in jobs.items()}, sys.stdout.buffer)


if __name__ == "__main__":
    main()
