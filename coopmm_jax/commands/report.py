"""``coopmm report``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path, result_folder, write_text
from coopmm_jax.page import CONTENT, REPORT, html, read_page, write_page

if TYPE_CHECKING:
    import xarray

    from coopmm_jax.commands import Subparsers
    from coopmm_jax.scenario.scenario import Scenario


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "report",
        help="report on a sweep's store, or make the page of a tuning, a comparison or falsify again",
        usage='coopmm report (STORE [--requirements.METRIC "<= LIMIT" ...] | DIR | FILE.toml) [--out DIR]',
        allow_abbrev=False,
    )
    parser.add_argument(
        "store",
        metavar="STORE|DIR|FILE",
        help="the zarr store of a sweep, complete or not; a folder of tune or compare; a scenario of falsify",
    )
    parser.add_argument(
        "--out", metavar="DIR", help="folder for the report (default: STORE's name with -report, else where it was)"
    )
    parser.set_defaults(run=run, parser=parser, takes_overrides=True, computes=False)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Print the report and write its files; other requirements than the sweep's may be given.

    Raises:
        UserError: an override of anything else, no sweep's store, or a folder that cannot be written.
    """
    source = resolve_path(options.store, "store")
    kept = source.with_suffix(".json") if source.suffix == ".toml" else source / CONTENT
    if kept.exists() or source.suffix == ".toml":
        folder = kept.parent if options.out is None else resolve_path(options.out, "--out")
        return _again(kept, folder / (REPORT if kept.name == CONTENT else f"{source.stem}.html"), changes)
    for name in changes:
        if not name.startswith("requirements."):
            raise UserError(f"--{name}", "one of --requirements.METRIC, which alone can be changed after a sweep", name)
    from coopmm_jax.sweeps import store as sweep_store  # imports zarr
    from coopmm_jax.sweeps.statistics import damaged

    data = sweep_store.open_sweep(options.store)
    scenario = sweep_store.scenario_of(data).with_overrides(changes) if changes else None
    folder = report_folder(options.store) if options.out is None else resolve_path(options.out, "--out")
    publish_and_print(folder, data, scenario)
    print(f"written to {folder}")
    if spoilt := damaged(data):
        must = "whole (coopmm sweep --resume computes the rest again)"
        raise UserError("store", must, f"{options.store} ({'; '.join(spoilt)})")
    return DONE


def _again(kept: Path, path: Path, changes: dict[str, Any]) -> int:
    """Make the page of a tuning, of a comparison or of falsify again, from what it kept."""
    for name in changes:
        raise UserError(f"--{name}", "left out where no sweep is reported on", "given")
    page = read_page(kept)
    with result_folder(path.parent) as hidden:
        write_text(hidden / path.name, html(page, kept.parent))
    print(f"written to {path}")
    return DONE


def report_folder(store: str | Path, option: str = "store") -> Path:
    """Default folder for the report of a store.

    >>> str(report_folder("runs/k0_5.5")), str(report_folder("runs/sensed.zarr"))
    ('runs/k0_5.5-report', 'runs/sensed-report')
    """
    path = resolve_path(store, option)
    return path.with_name(f"{path.name.removesuffix('.zarr')}-report")


def publish_and_print(
    folder: Path, data: xarray.Dataset, scenario: Scenario | None = None, slopes: bool | None = None
) -> None:
    """Write the report of a data set into a folder, print it, then draw its figures.

    Args:
        folder: of the report.
        data: of the sweep.
        scenario: with other requirements than the sweep's own.
        slopes: True computes them and prints them too; False removes what an earlier sweep left; None shows those that
            are there, if they are of these requirements.
    """
    from coopmm_jax.plotting.style import publish  # imports matplotlib
    from coopmm_jax.sweeps import page, report, slopes_table
    from coopmm_jax.sweeps.statistics import read_results

    results = read_results(data, scenario)
    with result_folder(folder) as hidden:
        report.write_numbers(hidden, results)
    print(report.text(results), flush=True)
    if slopes:
        slopes_table.compute_and_print(folder, results)
    elif slopes is False:
        (folder / slopes_table.FILE).unlink(missing_ok=True)  # of an earlier sweep, or of fewer samples
    publish(folder, report.drawings(data, results))
    write_page(folder, page.page(results, slopes_table.read(folder, results)))
