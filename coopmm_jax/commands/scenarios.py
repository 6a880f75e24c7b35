"""``coopmm scenarios``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.commented import commented
from coopmm_jax.scenario.scenario import list_scenarios, load_scenario, shipped
from coopmm_jax.scenario.validation import closest

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser("scenarios", help="list the shipped scenarios, or print one", allow_abbrev=False)
    parser.add_argument("name", metavar="NAME", nargs="?", help="of the scenario whose file is printed")
    parser.add_argument("--whole", action="store_true", help="with everything that its base says, too")
    parser.set_defaults(run=run, parser=parser, takes_overrides=False, computes=False)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Print one line for each scenario, or the file of one.

    Raises:
        UserError: no such scenario.
    """
    files = shipped()
    if options.name is None:
        if options.whole:
            raise UserError("--whole", "given with the name of a scenario", "given alone")
        described = list_scenarios()
        width = max(map(len, described))
        for name, description in described.items():
            print(f"{name:{width}}  {description}")
    elif options.name not in files:
        must = f"one of {', '.join(sorted(files))}{closest(options.name, files)}"
        raise UserError("NAME", must, options.name)
    elif options.whole:
        print(commented(load_scenario(options.name)), end="")
    else:
        print(files[options.name].read_text(encoding="utf-8"), end="")
    return DONE
