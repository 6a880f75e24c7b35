"""``coopmm metrics``."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.metrics.table import METRICS, Metric
from coopmm_jax.temporal_logic.signals import SIGNALS, SignalAbout

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    about = "list the metrics, which can be required, and the signals of which sentences in [requirements] speak"
    parser = commands.add_parser("metrics", help=about, allow_abbrev=False)
    parser.set_defaults(run=run, parser=parser, takes_overrides=False, computes=False)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Print name, unit and meaning of each metric and of each signal."""
    print("metrics of a run")
    _print(METRICS.values())
    print("\nsignals at each sample")
    _print(SIGNALS.values())
    return DONE


def _print(entries: Iterable[Metric | SignalAbout]) -> None:
    listed = list(entries)
    name_width = max(len(entry.name) for entry in listed)
    unit_width = max(len(entry.unit) for entry in listed)
    for entry in listed:
        print(f"  {entry.name:{name_width}}  {entry.unit:{unit_width}}  {entry.meaning}")
