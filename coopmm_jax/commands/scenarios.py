"""``coopmm scenarios``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.scenario.scenario import list_scenarios

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser("scenarios", help="list the shipped scenarios", allow_abbrev=False)
    parser.set_defaults(run=run, parser=parser, takes_overrides=False, computes=False)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Print one line for each scenario."""
    described = list_scenarios()
    width = max(map(len, described))
    for name, description in described.items():
        print(f"{name:{width}}  {description}")
    return DONE
