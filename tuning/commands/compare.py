"""``coopmm compare``."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.commands.fields import OVERRIDES
from coopmm_jax.commands.options import add_dask, add_overwrite, check_out, workers
from coopmm_jax.files import resolve_path, result_folder
from coopmm_jax.scenario.scenario import load_scenario

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "compare",
        help="run several sets of gains on the same uncertain robots and report the differences",
        usage=f"coopmm compare GAINS GAINS ... --scenario SCENARIO {OVERRIDES} [options]",
        epilog="Overrides change SCENARIO, over which each file is laid. coopmm simulate --help lists them.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "gains",
        metavar="GAINS",
        nargs="+",
        help='TOML file with [gains], a folder of coopmm tune or simulate, or the word "scenario" for SCENARIO\'s own',
    )
    parser.add_argument("--scenario", metavar="SCENARIO", required=True, help="a shipped name, or a TOML file")
    parser.add_argument("--samples", metavar="N", type=int, help="how many (default: SCENARIO's tuning.test_samples)")
    parser.add_argument("--seed", metavar="S", type=int, help="short for --simulation.seed")
    parser.add_argument("--out", metavar="DIR", help="folder for report.html, compare.txt, .json, .csv and figures")
    add_overwrite(parser)
    add_dask(parser)
    parser.set_defaults(run=run, parser=parser, takes_overrides=True, computes=True)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Compare, print, and write the report if a folder is named.

    Raises:
        UserError: results that are there already, or as ``load_scenario`` and ``compare_gains``.
    """
    if options.out is not None:
        check_out(options, resolve_path(options.out, "--out"))
    if options.seed is not None:
        changes = changes | {"simulation.seed": options.seed}
    scenario = load_scenario(options.scenario, **changes)
    from tuning.reports.compare import table, write_report
    from tuning.studies.compare import compare_gains  # imports JAX, as does the next

    with nullcontext() if options.out is None else result_folder(options.out) as folder:
        with workers(options) as executor:
            compared = compare_gains(scenario, options.gains, options.samples, executor)
        if folder is not None:
            write_report(folder, compared, options.gains)
    print(table(compared), end="")
    if options.out is not None:
        print(f"\nwritten to {options.out}")
    return DONE
