"""``coopmm check``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE, REQUIREMENT_BROKEN
from coopmm_jax.commands.fields import OVERRIDES
from coopmm_jax.commands.options import add_gains_file, add_overwrite, check_out, with_gains
from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path, result_folder, write_csv, write_json

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers
    from coopmm_jax.sweeps.check import Checked


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "check",
        help="run a folder of scenarios, with other gains, against their requirements",
        usage=f"coopmm check FOLDER [--gains-file FILE|DIR] {OVERRIDES} [--out FILE.json|FILE.csv]",
        epilog="Exit code 1 if a requirement is not met or a rollout fails. coopmm falsify --modes makes such folders; "
        "coopmm simulate --help lists the overrides.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", metavar="FOLDER", help="folder of scenario files with [requirements]")
    add_gains_file(parser)
    parser.add_argument("--out", metavar="FILE", help="table to write, .json or .csv")
    add_overwrite(parser)
    parser.set_defaults(run=run, parser=parser, takes_overrides=True, computes=True)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Check, print a line for each scenario, and write the table if a file is named.

    Raises:
        UserError: a file that exists or is no table, or as ``read_gains`` and ``scenarios_in``.
    """
    folder, out = resolve_path(options.folder, "FOLDER"), _new_file(options)
    if not folder.is_dir():
        raise UserError("FOLDER", "a folder with scenario files", folder)
    from coopmm_jax.sweeps.check import check, scenarios_in  # imports JAX

    found = check(scenarios_in(folder, with_gains(options, changes)))
    if out is not None:
        with result_folder(out.parent) as place:
            _write(place / out.name, found)
    for line in _lines(found):
        print(line)
    kept = sum(each.kept for each in found)
    print(f"{kept} of {len(found)} scenarios meet every requirement")
    return DONE if kept == len(found) else REQUIREMENT_BROKEN


def _new_file(options: argparse.Namespace) -> Path | None:
    if options.out is None:
        return None
    path = resolve_path(options.out, "--out")
    if path.suffix not in (".json", ".csv"):
        raise UserError("--out", "a .json or .csv file", options.out)
    check_out(options, path, file=True)
    return path


def _lines(found: list[Checked]) -> list[str]:
    """A line for each scenario: whether it keeps its requirements, and the robustness of each."""
    width = max(len(each.name) for each in found)
    lines = []
    for each in found:
        if each.status:
            about = f"the rollout fails at {each.status_time:g} s: {each.status.message}"
        else:
            robustness = each.robustness.values()
            short = (requirement.short for requirement in each.scenario.requirements.parsed())
            about = ", ".join(f"{name} {value:.4g}" for name, value in zip(short, robustness, strict=True))
        lines.append(f"{each.name:{width}}  {'kept ' if each.kept else 'FAILS'}  {about}")
    return lines


def _write(path: Path, found: list[Checked]) -> None:
    """Write the table: a row for each scenario and requirement."""
    if path.suffix == ".json":
        rows = [
            {"scenario": each.name, "kept": each.kept, "status": each.status.name, "robustness": each.robustness}
            for each in found
        ]
        write_json(path, {"kept": all(each.kept for each in found), "scenarios": rows})
        return
    header = ["scenario", "status", "requirement", "robustness", "unit", "met"]
    rows = []
    for each in found:
        known = each.scenario.requirements.metrics()
        units = (known[requirement.metric].unit for requirement in each.scenario.requirements.parsed())
        for unit, (name, value), met in zip(units, each.robustness.items(), each.met().values(), strict=True):
            rows.append([each.name, each.status.name, name, repr(value), unit, int(met)])
    write_csv(path, header, rows)
