"""``coopmm falsify``."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.commands.fields import OVERRIDES
from coopmm_jax.commands.options import add_dask, add_gains_file, add_overwrite, check_out, with_gains, workers
from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path, result_folder
from coopmm_jax.scenario.scenario import load_scenario

if TYPE_CHECKING:
    import numpy as np

    from coopmm_jax.commands import Subparsers
    from coopmm_jax.scenario.scenario import Scenario
    from tuning.studies.falsify import Falsification


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "falsify",
        help="search a scenario's uncertainty for the sample that hurts most",
        usage=f"coopmm falsify SCENARIO {OVERRIDES} [--requirement NAME] [--rollouts N] [--out FILE.toml] [options]",
        epilog="What is searched for is the highest cost, as coopmm tune reports it, or the least robustness of a "
        "requirement, or a rollout that fails. coopmm simulate --help lists the overrides.",
        allow_abbrev=False,
    )
    parser.add_argument("scenario", metavar="SCENARIO", help="a shipped scenario's name, or the path of a TOML file")
    parser.add_argument("--seed", metavar="S", type=int, help="short for --simulation.seed")
    add_gains_file(parser)
    parser.add_argument("--requirement", metavar="NAME", help="metric or sentence of [requirements] to be broken")
    parser.add_argument(
        "--modes",
        metavar="K",
        type=int,
        help="look for K different failures, of other requirements or far apart; DIR of --out takes their scenarios",
    )
    parser.add_argument(
        "--rollouts",
        metavar="N",
        type=int,
        default=409,
        help="budget, of each requirement with --modes (default %(default)d)",
    )
    parser.add_argument("--starts", metavar="N", type=int, default=32, help="of climbs (default %(default)d)")
    parser.add_argument(
        "--out", metavar="FILE|DIR", help="scenario file to write, for coopmm simulate, with a page beside it"
    )
    add_overwrite(parser)
    parser.add_argument(
        "--compare-random",
        metavar="N",
        type=int,
        nargs="?",
        const=0,
        help="compare with the worst of N random samples (default: as many as rollouts were spent)",
    )
    add_dask(parser)
    parser.set_defaults(run=run, parser=parser, takes_overrides=True, computes=True)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Search, print, and write the scenario if a file is named.

    Raises:
        UserError: a file that exists or cannot be written, or as ``load_scenario``, ``read_gains`` and ``falsify``.
    """
    if options.seed is not None:
        changes = changes | {"simulation.seed": options.seed}
    changes = with_gains(options, changes)
    if options.modes is not None:
        return _modes(options, load_scenario(options.scenario, **changes))
    path = None if options.out is None else _new_file(options)
    scenario = load_scenario(options.scenario, **changes)
    from tuning.reports.worst import write_page_with_figure, write_results  # imports JAX, as does the next
    from tuning.studies.falsify import table

    with nullcontext() if path is None else result_folder(path.parent) as folder:
        found, random = _search(options, scenario)
        if folder is not None and path is not None:
            write_results(folder, path.name, found, random, scenario, (options.rollouts, options.starts))
    print(table(found, random), end="", flush=True)
    if path is not None:
        write_page_with_figure(path, found, scenario)
        print(f"written to {options.out}; look at it by coopmm simulate {options.out}")
    return DONE


def _search(options: argparse.Namespace, scenario: Scenario) -> tuple[Falsification, np.ndarray | None]:
    """The sample found, and costs of random samples, if they are asked for."""
    from coopmm_jax.sweeps.engine import carried_by
    from tuning.cost.problem import build_problem, check_count, unscaled
    from tuning.studies.falsify import falsify, random_costs, requirement_of

    check_count(options.starts, "starts")
    if options.compare_random:
        check_count(options.compare_random, "--compare-random")
    broken = None if options.requirement is None else requirement_of(scenario, options.requirement)
    with workers(options) as executor, carried_by(executor):
        problem = build_problem(scenario) if broken is None else unscaled(scenario)
        found = falsify(scenario, options.rollouts, options.starts, problem, requirement=options.requirement)
        if options.compare_random is None:
            return found, None
        return found, random_costs(problem, options.compare_random or found.rollouts, broken)


def _modes(options: argparse.Namespace, scenario: Scenario) -> int:
    """Several failures in place of one sample."""
    if options.compare_random is not None:
        raise UserError("--compare-random", "left out where --modes is given", "given")
    target = None if options.out is None else resolve_path(options.out, "--out")
    if target is not None:
        check_out(options, target)
    from tuning.reports.modes import table, write_report  # imports JAX, as does the next
    from tuning.studies.modes import modes

    with nullcontext() if target is None else result_folder(target) as folder:
        with workers(options) as executor:
            found = modes(scenario, options.modes, options.requirement, options.rollouts, options.starts, executor)
        if folder is not None and found.found:
            write_report(folder, found, scenario, (options.rollouts, options.starts))
    print(table(found), end="")
    if target is not None and found.found:
        print(f"written to {options.out}; try other gains on them by coopmm check {options.out} --gains-file GAINS")
    return DONE


def _new_file(options: argparse.Namespace) -> Path:
    path = resolve_path(options.out, "--out")
    if path.suffix != ".toml":
        raise UserError("--out", "a .toml file", options.out)
    for written in (path, *(path.with_suffix(suffix) for suffix in (".html", ".csv", ".json", ".png"))):
        check_out(options, written, file=True)
    return path
