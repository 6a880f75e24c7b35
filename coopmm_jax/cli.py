"""Command ``coopmm``: its options, errors and exit codes; the work is done in ``commands``.

Exit codes: 0 done, 1 a requirement is not met (by ``coopmm check``), 2 the input cannot be used (one line on stderr),
3 a rollout failed (status, time, quantity), 128 plus a signal's number where one ended it: 130 for Ctrl-C, 141 where
nobody reads the output any more.

>>> main(["scenarios"])  # doctest: +ELLIPSIS
compliant...
0
"""

from __future__ import annotations

import argparse
import functools
import os
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import NoReturn

import coopmm_jax
from coopmm_jax import runtime, terminal
from coopmm_jax.commands import (
    BAD_INPUT,
    animate,
    check,
    help,
    init,
    metrics,
    report,
    scenarios,
    simulate,
    sweep,
    watch,
)
from coopmm_jax.commands.completion import SHELLS, PrintCompletion
from coopmm_jax.commands.fields import takes_names
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import plugins
from coopmm_jax.scenario import overrides
from coopmm_jax.scenario.validation import closest

ENTRY_POINTS = "coopmm_jax.commands"  # the group in which a package declares its subcommands


class UsageError(Exception):
    """A command line that argparse cannot read."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(message)

    def format_help(self) -> str:
        """Help with its epilog, which is long to make and seldom read."""
        make = self.get_default("epilog")
        self.epilog = self.epilog if make is None else make()
        return super().format_help()


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: the arguments; by default those of the process, which is then taken to run nothing else, so that XLA's
            options for fast compilation and the compilation cache are switched on.

    Returns:
        The exit code.
    """
    own_process = argv is None
    if own_process:
        terminal.prepare()
    try:
        with terminal.notices(only=own_process):
            code = _run(sys.argv[1:] if argv is None else argv, own_process)
            sys.stdout.flush()
            return code
    except BrokenPipeError:
        return terminal.close_pipe()
    except KeyboardInterrupt as stop:
        number = getattr(stop, "number", signal.SIGINT)
        if own_process:
            terminal.end(number)
        terminal.say("interrupted")
        return 128 + number
    except (UserError, UsageError, OSError, MemoryError, RuntimeError, AssertionError) as error:
        message = told(error)
        if message is None:
            raise
        terminal.say(f"error: {message}")
        return BAD_INPUT


def told(error: Exception) -> str | None:
    """Line for the user about an error that an input or the machine has caused; None for others."""
    if isinstance(error, UserError | UsageError):
        return str(error)
    if isinstance(error, OSError):  # a disk that fills up
        reason = error.strerror or error
        return f"{error.filename or 'output'}: must be a place with room and permission, was not ({reason})"
    if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):
        return f"memory: must be enough for this command, was exhausted ({error})"
    if "initialize backend" in str(error) or _without_device(error):
        platforms = os.environ.get("JAX_PLATFORMS", "")
        reason = str(error) or "no device of it"
        return f"JAX_PLATFORMS: must be a platform that JAX has here, was {platforms} ({reason})"
    return None


def _without_device(error: Exception) -> bool:
    """True if JAX knows the platforms asked for and has a device of none of them, which it only asserts."""
    asked = os.environ.get("JAX_PLATFORMS", "cpu").split(",")
    return isinstance(error, AssertionError) and "cpu" not in asked and not runtime.backend_is_up()


def _run(argv: Sequence[str], own_process: bool) -> int:
    argv, files = _plugins(argv)
    plugins.load_installed()
    for file in files:
        plugins.load_plugin(file)
    arguments, changes = overrides.split(argv, takes_names)
    for argument in arguments:
        if argument.endswith("=--"):  # argparse makes an empty list of it
            raise UserError(argument.removesuffix("=--"), "followed by a value", "followed by --")
    options, unknown = _parser(arguments[:1]).parse_known_args(arguments)
    if unknown:
        known = re.findall(r"--[\w.-]+", options.parser.format_help())
        raise UserError(unknown[0], f"an option of coopmm {options.command}{closest(unknown[0], known)}", "unknown")
    if changes and not options.takes_overrides:
        raise UserError(f"--{next(iter(changes))}", "given to a command that runs a scenario", options.command)
    if options.computes and own_process:
        runtime.use_fast_compilation(options.sweeps)
        if not options.sweeps:
            runtime.use_processor()
        runtime.use_compilation_cache()
    options.argv = [*argv, *(f"{plugins.OPTION}={file}" for file in files)]
    return options.run(options, changes)


def _plugins(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Command line without --plugin, and the files that it names; what they register, other options may mean."""
    others: list[str] = []
    files: list[str] = []
    following = iter(argv)
    for argument in following:
        option, equals, text = argument.partition("=")
        if option != plugins.OPTION:
            others.append(argument)
            continue
        file = text if equals else next(following, None)
        if file is None:
            raise UserError(plugins.OPTION, "followed by a Python file", "followed by nothing")
        files.append(file)
    return others, files


def _parser(command: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of all commands, of which ``command`` ([] or [name]) must be one."""
    parser = _Parser(prog="coopmm", description=(coopmm_jax.__doc__ or "").partition("\n")[0], allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"coopmm {coopmm_jax.__version__}")
    parser.add_argument(plugins.OPTION, metavar="FILE", help="Python file that registers kinds; may be given again")
    parser.add_argument(
        "--print-completion", choices=SHELLS, action=PrintCompletion, help="print a script of completions for a shell"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    parser.set_defaults(sweeps=False)
    for module in _modules():
        module.add(commands)
    for name in command:
        if not name.startswith("-") and name not in commands.choices:
            must = f"one of {', '.join(commands.choices)}{closest(name, commands.choices)}"
            hint = "" if _declared() else "; those of other packages, like tune, are there once pip has installed these"
            raise UserError("COMMAND", must + hint, name)
    return parser


def _modules() -> Iterator[ModuleType]:
    """Modules of all subcommands: this package's, and those that installed packages declare as entry points.

    Raises:
        UserError: a module that cannot be imported.
    """
    yield from (simulate, animate, sweep, check, report, watch, init, scenarios, metrics, help)
    for point in _declared():
        try:
            yield point.load()
        except (ImportError, AttributeError) as error:
            raise UserError(f"coopmm {point.name}", f"a module that can be imported ({point.value})", error) from None


@functools.cache
def _declared() -> tuple[EntryPoint, ...]:
    """Subcommands that installed packages declare, read from the files of every one."""
    return tuple(sorted(entry_points(group=ENTRY_POINTS)))


if __name__ == "__main__":
    sys.exit(main())
