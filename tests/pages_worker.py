"""The commands and Python blocks of pages at small size, as JSON: run by ``pages.carried_out`` in a process of its own.

Of its own, as it makes small what has no option for it. Readers come on the standard input, as [folder, jobs], jobs as
[kind, text, more words].
"""

import contextlib
import functools
import gc
import importlib
import inspect
import io
import json
import math
import re
import shlex
import subprocess
import sys
import time
import traceback
from pathlib import Path
from types import SimpleNamespace

import jax

from coopmm_jax import cli, runtime
from coopmm_jax.kinds import plugins, registry
from coopmm_jax.parameters import Gains
from experiments import fuzz_kinds, readme_media
from experiments.benchmarks import falsify, gradients, loops, rollout, sweep, tuners, tuning_quality
from tests.pictures import leave_pictures_blank
from tests.small_commands import COST, HORIZON, SWEPT

VALUE = re.compile(r"^(\S.*?) +# (-?\d+(?:\.\d+)?) ")  # a line of Python with what it is said to give


def make_experiments_small():
    """Make small the experiments that no option makes so: shorter, fewer, or traced without being compiled.

    Costs are those of the commands, which one program has.
    """
    cost = {f"tuning.{name}": value for name, value in COST.items()}
    times = dict.fromkeys(("force_time", "robots_time", "tuned_time"), HORIZON)
    readme_media.write_media = functools.partial(readme_media.write_media, **times)
    compare = readme_media.compare_gains
    readme_media.compare_gains = lambda scenario, *more, **few: compare(scenario.with_overrides(cost), *more, **few)
    rollout._compiled = _traced
    rollout.apart = lambda _, function, *arguments: function(*arguments)  # a new process would not be small
    ideal = {loops.IDEAL: loops.loops()[loops.IDEAL]}
    loops.loops, loops.DURATIONS = lambda: ideal, {1: 0.01}
    # One sweep for all cases, with the programs of ``coopmm sweep sensed``; what it takes says nothing here.
    sweep.SCENARIO, sweep.LONGEST, sweep.LARGEST = "sensed", math.inf, math.inf
    sweep.FIRST = sweep.SCALE = sweep.SHORT_FIRST = sweep.FEW = sweep.MANY = sweep.Case(16, HORIZON)
    sweep.measure = functools.cache(sweep.measure)
    sweep.subprocess = SimpleNamespace(DEVNULL=subprocess.DEVNULL, Popen=_swept)
    falsify.HORIZON = tuners.DURATION = HORIZON
    scenario = falsify.scenario
    falsify.scenario = lambda *which: scenario(*which).with_overrides(cost)
    tuners.PROBLEMS["shared"][1]["precision"] = "float64"  # one program less to compile
    fuzz_kinds.fuzz = functools.partial(fuzz_kinds.fuzz, rollouts=False)  # test_fuzz.py has them
    # Its command in this process, which has compiled what it runs and can no longer change XLA's options.
    tuning_quality.subprocess = SimpleNamespace(run=lambda line, **_: cli.main(line[3:]))
    tuning_quality.runtime = SimpleNamespace(use_fast_compilation=lambda batches: True, use_compilation_cache=Path)
    gradients._reverse = functools.partial(gradients._differences, step=1e-4)  # the gradient takes half a minute
    build, few = gradients.build_problem, cost | {"tuning.gains": list(Gains.tuned)}
    gradients.build_problem = lambda scenario: build(scenario.with_overrides(few))


def _swept(line, cwd, stdout):
    """Run the command of a line of the sweep's benchmark here, and give it a process whose use it can ask for."""
    with contextlib.chdir(cwd):
        assert cli.main([*line[3:], *SWEPT[2:]]) == 0
    return subprocess.Popen([sys.executable, "-c", ""], stdout=stdout)


def _traced(name, precision, elements, steps, function, *arguments):
    if elements == 1 and "gradient" not in name:  # the others take long even to trace, and differ in a vmap or a grad
        jax.eval_shape(function, *arguments)
    return rollout.Program(name, precision, elements, steps, 0.0, 0.0, lambda: time.sleep(1e-4))


def run_command(text, more):
    """Exit code of a command with more words at its end."""
    program, *words = shlex.split(text, comments=True)
    main = cli.main
    if program == "python":
        assert words[0] == "-m", text
        module = importlib.import_module(words[1])
        main = getattr(module, "main", None) or importlib.import_module(f"{words[1]}.__main__").main
        words = words[2:]
    sys.argv = [program, *words, *more]
    try:
        with jax.enable_x64(jax.config.jax_enable_x64):  # a command may set it for the rest of its process
            return main(sys.argv[1:]) if inspect.signature(main).parameters else main()
    except SystemExit as ended:  # argparse, after help or a bad option
        return ended.code


def run_block(text, names):
    """Execute a block among the names of those before it; the lines that say their value, with what it is."""
    exec(text, names)
    lines = filter(None, map(VALUE.match, text.splitlines()))
    return [(float(line[2]), float(eval(line[1], names))) for line in lines]


def carry_out(jobs):
    """For each job its exit code or what its lines gave, what it said, and its seconds of CPU."""
    names, results = {}, []
    for kind, text, more in jobs:
        said = io.StringIO()
        began = time.process_time()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            try:
                outcome = run_command(text, more) if kind == "command" else run_block(text, names)
            except Exception:
                outcome = traceback.format_exc()
        results.append({"outcome": outcome, "said": said.getvalue(), "seconds": time.process_time() - began})
    return results


@contextlib.contextmanager
def a_new_reader(folder):
    """Work in a folder, with no plugins but those that are named there."""
    before = registry._KINDS, plugins._loaded, plugins._contents
    registry._KINDS = {group: dict(kinds) for group, kinds in registry._KINDS.items()}
    plugins._loaded, plugins._contents = dict(plugins._loaded), dict(plugins._contents)
    with contextlib.chdir(folder):
        yield
    registry._KINDS, plugins._loaded, plugins._contents = before


def main():
    """Print the results of each reader."""
    assert runtime.use_fast_compilation()
    make_experiments_small()
    leave_pictures_blank()
    results = []
    for folder, jobs in json.load(sys.stdin):
        with a_new_reader(folder):
            results.append(carry_out(jobs))
    print(json.dumps(results))
    gc.freeze()  # leaves nothing to the collections at the end


if __name__ == "__main__":
    main()
