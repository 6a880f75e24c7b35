"""``coopmm help``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from coopmm_jax.commands import DONE
from coopmm_jax.commands.fields import OVERRIDES, section_help
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.catalogue import sections
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.sections.uncertainty import Distribution, shapes
from coopmm_jax.scenario.validation import closest

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers

_FREE = ("disturbance", "uncertainty", "requirements", "schedule")  # sections that the user gives names or entries


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "help",
        help="tell the fields of one section, with the values that a scenario has there",
        usage=f"coopmm help [SECTION | COMMAND] [--scenario SCENARIO] {OVERRIDES}",
        allow_abbrev=False,
    )
    parser.add_argument("topic", metavar="SECTION", nargs="?", help="of a scenario, or a command; all if left out")
    parser.add_argument("--scenario", metavar="SCENARIO", help="a shipped scenario's name, or the path of a TOML file")
    parser.set_defaults(run=run, parser=parser, takes_overrides=True, computes=False, commands=commands.choices)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Print the fields of a section, the help of a command, or the list of all sections.

    Raises:
        UserError: no such section, overrides without a scenario, or as ``load_scenario``.
    """
    known = sections()
    if changes and options.scenario is None:
        raise UserError(f"--{next(iter(changes))}", "given together with --scenario", "given alone")
    scenario = load_scenario(options.scenario, **changes) if options.scenario is not None else None
    if options.topic is None:
        print("\n".join(known.values()))
        print("\ncoopmm help SECTION tells the fields of one, --scenario SCENARIO with its own values.")
    elif options.topic in known:
        label = Path(options.scenario or "").stem
        print("\n".join([*section_help(options.topic, label, scenario), *_more(options.topic, label, scenario)]))
    elif options.topic in options.commands:
        options.commands[options.topic].print_help()
    else:
        topics = [*known, *options.commands]
        must = f"one of {', '.join(known)}, or a command{closest(options.topic, topics)}"
        raise UserError("SECTION", must, options.topic)
    return DONE


def _more(section: str, label: str, scenario: Scenario | None) -> Iterator[str]:
    """Lines on what has no fields with fixed names."""
    if section == "uncertainty":
        yield from (f"  {name:28} {' and '.join(numbers)}" for name, numbers in shapes().items())
        fields = Distribution.model_fields.items()
        yield from (f"  {name:28} {info.description}" for name, info in fields if info.description)
    if section == "requirements":
        yield "  coopmm metrics lists what can be required, and the signals that sentences speak of"
    if scenario is not None and section in _FREE:
        table = scenario.model_dump(exclude_none=True, exclude_defaults=section == "uncertainty", include={section})
        yield from ("", f"{label} has", "", tomli_w.dumps(table).rstrip("\n"))
