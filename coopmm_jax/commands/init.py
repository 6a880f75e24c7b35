"""``coopmm init``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.commands.fields import OVERRIDES
from coopmm_jax.commands.options import add_overwrite, check_out
from coopmm_jax.errors import UserError, one_line
from coopmm_jax.files import resolve_path, result_folder, write_text
from coopmm_jax.scenario.commented import commented
from coopmm_jax.scenario.scenario import based_on, load_scenario

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "init",
        help="write a commented scenario file to start from",
        usage=f"coopmm init FILE.toml [--scenario SCENARIO] {OVERRIDES} [--overwrite]",
        epilog="Every value is spelt out, with its meaning and unit. Overrides are written into the file.",
        allow_abbrev=False,
    )
    parser.add_argument("out", metavar="FILE", help="scenario file to write")
    parser.add_argument("--scenario", metavar="SCENARIO", default="sensed", help="to start from (default %(default)s)")
    add_overwrite(parser)
    parser.set_defaults(run=run, parser=parser, takes_overrides=True, computes=False)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Write the file.

    Raises:
        UserError: a file that exists or cannot be written, or as ``load_scenario``.
    """
    path = resolve_path(options.out, "FILE")
    if path.suffix != ".toml":
        raise UserError("FILE", "a .toml file", options.out)
    check_out(options, path, option="FILE", file=True)
    own = {"description": based_on(options.scenario)}  # what is edited is no longer what the other one says
    scenario = load_scenario(options.scenario, **own | _found_from_anywhere(changes))
    head = f"# Scenario for coopmm, begun from {one_line(options.scenario)}; coopmm help SECTION tells more.\n\n"
    with result_folder(path.parent, "FILE") as folder:
        write_text(folder / path.name, head + commented(scenario))
    print(f"written to {path}; run it by coopmm simulate {path}")
    return DONE


def _found_from_anywhere(changes: dict[str, Any]) -> dict[str, Any]:
    """Changes with the names of files as absolute paths: a scenario's own are looked for beside it."""
    return {
        name: str(resolve_path(value, f"--{name}").absolute())
        if name.endswith(".file") and isinstance(value, str)
        else value
        for name, value in changes.items()
    }
