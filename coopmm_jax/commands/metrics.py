"""``coopmm metrics``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from coopmm_jax.commands import DONE
from coopmm_jax.metrics.table import METRICS

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser("metrics", help="list the metrics, which can be required", allow_abbrev=False)
    parser.set_defaults(run=run, parser=parser, takes_overrides=False, computes=False)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Print name, unit and meaning of each metric."""
    name_width = max(map(len, METRICS))
    unit_width = max(len(metric.unit) for metric in METRICS.values())
    for metric in METRICS.values():
        print(f"{metric.name:{name_width}}  {metric.unit:{unit_width}}  {metric.meaning}")
    return DONE
