"""``coopmm tune``."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.commands.fields import OVERRIDES, fields_help
from coopmm_jax.commands.options import add_dask, add_gains_file, add_overwrite, check_out, with_gains, workers
from coopmm_jax.errors import UserError
from coopmm_jax.files import locked_folder, resolve_path, result_folder
from coopmm_jax.scenario.scenario import Scenario, load_scenario

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers

ADVERSARIES = 4  # of --adversarial: as many samples as a generation draws


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "tune",
        help="tune gains against a scenario's uncertainty and report what it brought on untouched samples",
        usage=f"coopmm tune SCENARIO {OVERRIDES} [options]",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("scenario", metavar="SCENARIO", help="a shipped scenario's name, or the path of a TOML file")
    parser.add_argument("--seed", metavar="S", type=int, help="short for --simulation.seed")
    add_gains_file(parser, "gains to start from: a TOML file, or a folder of coopmm tune or simulate")
    parser.add_argument("--out", metavar="DIR", default="tuned", help="folder for all results (default tuned)")
    parser.add_argument(
        "--time-budget", metavar="SECONDS", type=float, help="end the search after that long; --resume goes on"
    )
    parser.add_argument("--resume", action="store_true", help="go on with the run in DIR, with the same settings")
    add_overwrite(parser)
    parser.add_argument("--pareto", metavar="K", type=int, help="tune K weightings between quality and effort at once")
    parser.add_argument(
        "--controllers",
        metavar="A,B,...",
        help="tune each of these with equal effort, then compare them",
    )
    parser.add_argument(
        "--adversarial",
        action="store_true",
        help=f"train on the worst samples too that are found on the way, short for --tuning.adversaries {ADVERSARIES}",
    )
    add_dask(parser)
    parser.set_defaults(run=run, parser=parser, epilog=fields_help, takes_overrides=True, computes=True, sweeps=True)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Tune, then print and write the report.

    Raises:
        UserError: options that exclude each other, results that are there already, or as ``read_gains``,
            ``load_scenario``, ``tune``, ``tune_controllers`` and ``tune_front``.
    """
    if options.seed is not None:
        changes = changes | {"simulation.seed": options.seed}
    if options.adversarial:
        changes = {"tuning.adversaries": ADVERSARIES} | changes
    scenario = load_scenario(options.scenario, **with_gains(options, changes))
    if options.resume and options.overwrite:
        raise UserError("--overwrite", "left out where --resume is given", "given")
    if not options.resume:
        check_out(options, resolve_path(options.out, "--out"), more="--resume or ")
    if options.pareto is not None:
        return _front(scenario, options)
    if options.controllers is not None:
        return _controllers(scenario, options)
    from tuning.commands.progress import Progress
    from tuning.reports.tune import table, write_report  # slow to import, as the next
    from tuning.studies.state import NAME, SETTINGS
    from tuning.studies.tune import tune

    shown = Progress(scenario.tuning)
    limit = math.inf if options.time_budget is None else options.time_budget
    again = shlex.join(
        ["coopmm", "tune", str(resolve_path(options.out, "--out") / SETTINGS), "--out", str(options.out), "--resume"]
    )
    try:
        with workers(options) as executor:
            told = (shown.row, shown.stage, limit, options.overwrite, executor)
            result = tune(scenario, options.out, options.resume, *told)
    except KeyboardInterrupt:
        if (resolve_path(options.out, "--out") / NAME).exists():
            print(f"\ngo on by {again}", file=sys.stderr)
        raise
    with result_folder(options.out) as folder:
        write_report(folder, result, scenario)
    print(table(result), end="")
    if result.resumable:
        print(f"go on by {again}")
    print(f"written to {options.out}; use the gains by coopmm simulate SCENARIO --gains-file {options.out}/gains.toml")
    return DONE


def _controllers(scenario: Scenario, options: argparse.Namespace) -> int:
    """Several controllers in place of one."""
    from tuning.commands.progress import Progress
    from tuning.reports import compare, tune  # slow to import, as the next
    from tuning.studies.controllers import tune_controllers
    from tuning.studies.state import NAME, SETTINGS

    target = resolve_path(options.out, "--out")
    limit = math.inf if options.time_budget is None else options.time_budget
    shown = Progress(scenario.tuning)
    names = [name.strip() for name in options.controllers.split(",")]
    with locked_folder(target), workers(options) as executor:
        told = (shown.row, shown.stage, limit, options.overwrite, executor)
        try:
            tuned = tune_controllers(scenario, names, target, options.resume, *told)
        except KeyboardInterrupt:
            if any((target / name / NAME).exists() for name in names):
                words = [word for word in options.argv if word not in ("--overwrite", "--resume")]
                print(f"\ngo on by {shlex.join(['coopmm', *words, '--resume'])}", file=sys.stderr)
            raise
        for name, result in tuned.results.items():
            with result_folder(target / name) as folder:
                tune.write_report(folder, result, load_scenario(target / name / SETTINGS))
        with result_folder(target) as folder:
            compare.write_report(folder, tuned.compared)
    print(compare.table(tuned.compared), end="")
    print(f"written to {options.out}; gains and a report of each controller in a folder of its name there")
    return DONE


def _front(scenario: Scenario, options: argparse.Namespace) -> int:
    """The front between quality and effort in place of one tuning."""
    for option in ("resume", "controllers"):
        if getattr(options, option):
            raise UserError(f"--{option}", "left out where --pareto is given", "given")
    if scenario.tuning.goals != "cost":
        raise UserError("tuning.goals", "cost where --pareto is given", scenario.tuning.goals)
    if scenario.tuning.adversaries:
        raise UserError("tuning.adversaries", "0 where --pareto is given", scenario.tuning.adversaries)
    from tuning.commands.progress import Progress
    from tuning.reports.pareto import clear, table, write_report  # slow to import, as the next
    from tuning.studies.pareto import tune_front

    target = resolve_path(options.out, "--out")
    shown = Progress(scenario.tuning)
    with locked_folder(target), result_folder(target) as folder:
        with workers(options) as executor:
            front = tune_front(scenario, options.pareto, shown.row, shown.stage, executor)
        clear(target)
        write_report(folder, front)
    print(table(front), end="")
    print(f"written to {options.out}; compare gains by coopmm compare scenario {options.out}/gains_*.toml --scenario S")
    return DONE
