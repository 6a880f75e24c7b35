"""The subcommands of ``coopmm``, one module each: ``add`` declares its arguments, ``run`` does it.

A module's parser sets three defaults: ``run``; ``takes_overrides``, true if --section.field may be given; ``computes``,
true if it runs rollouts, for which XLA's options are worth setting. A fourth, ``sweeps``, says that most of its time
goes into large batches, without gradients.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]  # what ``add`` adds a parser to

DONE, REQUIREMENT_BROKEN, BAD_INPUT, ROLLOUT_FAILED = 0, 1, 2, 3  # exit codes
