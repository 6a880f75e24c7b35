"""Shell completion: ``coopmm --print-completion bash`` prints a script for the shell to read at its start."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any

from coopmm_jax.commands.fields import option
from coopmm_jax.scenario.catalogue import Entry, entries, sections
from coopmm_jax.scenario.scenario import shipped

SHELLS = ("bash", "zsh")
_FILES = ("FILE", "STORE", "GAINS", "FILE|DIR", "SCENARIO|DIR")  # what stands for a path in help
_WORDS = {"SCENARIO": "_coopmm_scenarios", "NAME": "_coopmm_names", "SECTION": "_coopmm_topics"}  # shell functions


class PrintCompletion(argparse.Action):
    """Option that prints the completion script of a shell, overrides of a scenario's fields included, and ends."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Print the script of the shell ``values``."""
        import shtab

        commands = _commands(parser)
        for command in commands.values():
            _describe(command, shtab)
            if command.get_default("takes_overrides"):
                _add_overrides(command)
        preamble: Any = _preamble(commands)  # by shell, whatever shtab's annotation says
        print(shtab.complete(parser, values, preamble=preamble))
        parser.exit(0)


def _commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Parsers of all subcommands by name."""
    subparsers = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return {name: command for action in subparsers for name, command in action.choices.items()}


def _describe(command: argparse.ArgumentParser, shtab: Any) -> None:
    """Say of each argument that names a path, a scenario or a section that it does."""
    for action in command._actions:
        metavar, found = str(action.metavar), None
        if metavar in _WORDS:
            found = dict.fromkeys(SHELLS, _WORDS[metavar])
        elif metavar in _FILES:
            found = shtab.FILE
        elif metavar == "DIR":
            found = shtab.DIRECTORY
        if found is not None:
            action.complete = found  # pyright: ignore[reportAttributeAccessIssue] - where shtab looks for it


def _add_overrides(command: argparse.ArgumentParser) -> None:
    known: dict[str, Entry] = {}
    for name in sections():
        known |= {option(entry.place): entry for entry in entries(name) if not entry.heading}
    for name, entry in known.items():
        command.add_argument(name, choices=entry.choices or None, help=entry.text)


def _preamble(commands: Iterable[str]) -> dict[str, str]:
    """Shell functions that list shipped scenarios, with or without files, and what there is help on."""
    names, topics = " ".join(sorted(shipped())), " ".join([*sections(), *commands])
    files = '; compgen -f -X "!*.toml" -- "$1"; compgen -d -- "$1"'
    bash, zsh = [], []
    for metavar, function in _WORDS.items():
        words = topics if metavar == "SECTION" else names
        bash.append(f'{function}() {{ compgen -W "{words}" -- "$1"{files if metavar == "SCENARIO" else ""}; }}')
        zsh.append(f"{function}() {{ compadd {words}{'; _files' if metavar == 'SCENARIO' else ''}; }}")
    return {"bash": "\n".join(bash), "zsh": "\n".join(zsh)}
