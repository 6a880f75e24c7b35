"""``coopmm sweep``."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.commands.fields import OVERRIDES, fields_help
from coopmm_jax.commands.options import add_dask, add_gains_file, add_overwrite, with_gains, workers
from coopmm_jax.commands.report import publish_and_print, report_folder
from coopmm_jax.errors import UserError
from coopmm_jax.files import check_folder, resolve_path, write_text
from coopmm_jax.scenario.overrides import merged, read_toml
from coopmm_jax.scenario.scenario import load_scenario

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers

_MOST_JOBS = 10_000


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "sweep",
        help="simulate many samples of a scenario's uncertainty and report how often its requirements are met",
        usage=f"coopmm sweep SCENARIO {OVERRIDES} [options]",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("scenario", metavar="SCENARIO", help="a shipped scenario's name, or the path of a TOML file")
    add_gains_file(parser)
    parser.add_argument("--uncertainty", metavar="FILE", help="TOML file with [uncertainty] and [requirements]")
    parser.add_argument("--samples", metavar="N", type=int, help="how many (default 1000)")
    parser.add_argument("--seed", metavar="S", type=int, help="short for --simulation.seed")
    parser.add_argument("--sampling", default="independent", help="independent (default), or sobol")
    parser.add_argument("--out", metavar="STORE", default="sweep.zarr", help="zarr store (default sweep.zarr)")
    parser.add_argument("--resume", action="store_true", help="go on with STORE, and make it larger if N says so")
    add_overwrite(parser)
    parser.add_argument("--keep", metavar="K", type=int, default=64, help="keep time series of K samples (default 64)")
    parser.add_argument("--batch", metavar="B", type=int, help="samples in one call (default: what suits the device)")
    parser.add_argument("--rank", metavar="R", type=int, help="number of this process, if several share STORE")
    parser.add_argument("--size", metavar="P", type=int, help="number of these processes")
    parser.add_argument("--coordinator", metavar="HOST:PORT", help="where they meet through jax.distributed")
    parser.add_argument("--distributed", action="store_true", help="let jax.distributed find rank, size, coordinator")
    parser.add_argument(
        "--slopes", action="store_true", help="how success probabilities change with every gain and tolerance"
    )
    add_dask(parser)
    parser.add_argument(
        "--slurm", metavar="N", type=int, help="write a script of N Slurm jobs beside STORE, run nothing"
    )
    parser.set_defaults(run=run, parser=parser, epilog=fields_help, takes_overrides=True, computes=True, sweeps=True)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Sweep, then report if this process finds all batches complete.

    Raises:
        UserError: an unusable file of --uncertainty, or as ``load_scenario``, ``share`` and ``sweep``.
    """
    if options.uncertainty is not None:
        changes = merged(_uncertainty_file(options.uncertainty), changes)
    scenario = load_scenario(options.scenario, **with_gains(options, changes))
    if options.slurm is not None:
        return _write_jobs(options)
    if options.slopes and options.samples == 1:
        raise UserError("--samples", "at least 2 where --slopes is given", 1)
    from coopmm_jax.sweeps.processes import share  # imports JAX, as does the next
    from coopmm_jax.sweeps.run import sweep

    folder = report_folder(options.out, "out")
    check_folder(folder)
    mine = share(options.rank, options.size, options.coordinator, options.distributed)
    names = ("samples", "seed", "sampling", "out", "resume", "overwrite", "keep", "batch")
    with workers(options) as executor:
        data = sweep(scenario, **{name: getattr(options, name) for name in names}, share=mine, executor=executor)
    missing = int((data.status < 0).sum())
    if missing:
        print(f"{missing} of {data.sizes['sample']} samples are left to other processes, or to --resume")
        return DONE
    publish_and_print(folder, data, slopes=options.slopes)
    print(f"written to {options.out} and {folder}")
    return DONE


def _write_jobs(options: argparse.Namespace) -> int:
    """Write a job array of which each task runs its share of this sweep.

    Raises:
        UserError: no number of jobs, or another way to share the work.
    """
    if not 1 <= options.slurm <= _MOST_JOBS:
        raise UserError("--slurm", f"from 1 to {_MOST_JOBS} jobs", options.slurm)
    for name in ("rank", "size", "coordinator", "distributed", "dask", "overwrite"):
        if getattr(options, name):
            raise UserError(f"--{name}", "left out where --slurm is given", "given")
    store = resolve_path(options.out, "out")
    path = store.with_suffix(".slurm")
    if path.exists():
        raise UserError("--slurm", "used where no script is yet", path)
    words = [*without(options.argv, "--slurm"), *([] if options.resume else ["--resume"])]
    lines = (
        "#!/bin/sh",
        f"#SBATCH --job-name={store.stem}",
        f"#SBATCH --array=0-{options.slurm - 1}",
        "#SBATCH --cpus-per-task=2",
        f"#SBATCH --output={store.stem}.%a.log",
        f'exec coopmm {shlex.join(words)} --rank "$SLURM_ARRAY_TASK_ID" --size {options.slurm}',
    )
    write_text(path, "\n".join(lines) + "\n")
    print(f"written to {path}; submit it by sbatch {path}, read what it found by coopmm report {options.out}")
    return DONE


def without(argv: Sequence[str], option: str) -> list[str]:
    """Command line without an option and its value.

    >>> without(["sweep", "sensed", "--slurm", "8", "--keep=0"], "--slurm")
    ['sweep', 'sensed', '--keep=0']
    """
    places = [i for i, word in enumerate(argv) if word == option]
    dropped = {*places, *(i + 1 for i in places)}
    return [word for i, word in enumerate(argv) if i not in dropped and not word.startswith(f"{option}=")]


def _uncertainty_file(path: str) -> dict[str, Any]:
    tables = read_toml(path, "--uncertainty")
    for name in tables:
        if name not in ("uncertainty", "requirements"):
            raise UserError(f"--uncertainty {path}", "a file of [uncertainty] and [requirements]", f"one with {name}")
    return tables
