"""Gains in a file of their own: what ``coopmm tune`` writes and ``--gains-file`` reads.

>>> gains_text({"K_lambda": [1.0, 2.0]}, {})
'[gains]\\nK_lambda = [\\n    1.0,\\n    2.0,\\n]\\n'
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import tomli_w

from coopmm_jax.errors import UserError

_SECTIONS = ("gains", "law")


def gains_text(gains: dict[str, Any], law: dict[str, Any]) -> str:
    """TOML of the sections [gains] and, if anything of it was tuned, [law]."""
    return tomli_w.dumps({"gains": gains} | ({"law": law} if law else {}))


def read_gains(path: str | Path) -> dict[str, Any]:
    """The tables of a gains file, to be laid over a scenario.

    Raises:
        UserError: a file that cannot be read, or that holds anything but [gains] and [law].
    """
    try:
        tables = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError("--gains-file", "a file that can be read", f"{path} ({error.strerror})") from None
    except ValueError as error:
        raise UserError("--gains-file", "a TOML file", f"{path} ({error})") from None
    others = [name for name in tables if name not in _SECTIONS]
    if others or "gains" not in tables:
        raise UserError("--gains-file", "a file of [gains] and [law]", f"{path} with {', '.join(tables) or 'nothing'}")
    return tables
