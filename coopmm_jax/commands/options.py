"""Options that several commands share: gains from elsewhere, and results that may be replaced."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from coopmm_jax.files import check_unused
from coopmm_jax.scenario.gains_file import read_gains
from coopmm_jax.scenario.overrides import merged

GAINS = "TOML file with [gains], as coopmm tune writes it, or a folder of coopmm tune or simulate"


def add_gains_file(parser: argparse.ArgumentParser, meaning: str = GAINS) -> None:
    """Let a command take its scenario's gains from elsewhere."""
    parser.add_argument("--gains-file", metavar="FILE|DIR", help=meaning)


def with_gains(options: argparse.Namespace, changes: dict[str, Any]) -> dict[str, Any]:
    """Changes to the scenario, the gains of --gains-file among them; what the command line says counts more.

    Raises:
        UserError: as ``read_gains``.
    """
    return changes if options.gains_file is None else merged(read_gains(options.gains_file), changes)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Let a command replace what stands in the place of its results."""
    parser.add_argument("--overwrite", action="store_true", help="replace results that are there already")


def check_out(
    options: argparse.Namespace, target: Path, *, option: str = "--out", file: bool = False, more: str = ""
) -> None:
    """Refuse to replace results unasked.

    Args:
        options: of the command line.
        target: of the results.
        option: what the user knows the target as.
        file: it is to be a file, not a folder.
        more: another option that would help.

    Raises:
        UserError: there are results, and --overwrite is not given.
    """
    if not options.overwrite:
        check_unused(target, option, file=file, help_by=f"{more}--overwrite")


def add_dask(parser: argparse.ArgumentParser) -> None:
    """Let a command run its rollouts on Dask's workers."""
    meaning = "run on the workers of this Dask scheduler (tcp://head:8786), or on N processes of this machine (local:N)"
    parser.add_argument("--dask", metavar="ADDRESS", help=meaning)


@contextlib.contextmanager
def workers(options: argparse.Namespace) -> Iterator[Executor | None]:
    """Executor of --dask; None without.

    Raises:
        UserError: as ``connected``.
    """
    if options.dask is None:
        yield None
        return
    from coopmm_jax.sweeps.dask import connected

    with connected(options.dask) as executor:
        yield executor
