"""Changes to a scenario: nested tables, dotted keys, and the command line's ``--section.field value``.

>>> merged({"gains": {"beta": 1.0, "K_u": 1.0}}, {"gains.beta": 2.0})
{'gains': {'beta': 2.0, 'K_u': 1.0}}
>>> split(["paper", "--gains.K-sigma", "1", "-1e-3", "--out", "results"])
(['paper', '--out', 'results'], {'gains.K_sigma': [1, -0.001]})
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coopmm_jax.errors import UserError


def read_toml(path: str | Path, field: str) -> dict[str, Any]:
    """The tables of a TOML file that the user has named.

    Raises:
        UserError: of ``field``, where the file cannot be read or is not TOML.
    """
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(field, "a file that can be read", f"{path} ({error.strerror})") from None
    except ValueError as error:  # of the TOML parser, which says where, or of the decoding
        raise UserError(field, "a TOML file", f"{path} ({error})") from None


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes`` laid over it: tables are merged, everything else replaced.

    A key of ``changes`` with dots stands for nested tables. numpy's scalars and arrays become numbers and lists.
    """
    result = dict(base)
    for dotted, value in changes.items():
        key, _, rest = dotted.partition(".")
        value = {rest: value} if rest else value
        if isinstance(value, Mapping):
            inner = result.get(key)
            result[key] = merged(inner if isinstance(inner, Mapping) else {}, value)
        else:
            result[key] = value.tolist() if hasattr(value, "tolist") else value
    return result


def split(arguments: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """Take the overrides out of a command line.

    An override is ``--section.field`` (a hyphen in it stands for an underscore), then ``=value`` or any number of
    values up to the next option. Values are read by ``value_of``.

    Returns:
        The other arguments, and the overrides with dotted keys.

    Raises:
        UserError: an override without a value.
    """
    others: list[str] = []
    texts: dict[str, list[str]] = {}
    current = others
    for argument in arguments:
        option, equals, text = argument.partition("=")
        if option.startswith("--") and "." in option:
            values = texts[option[2:].replace("-", "_")] = [text] if equals else []
            current = others if equals else values
        elif current is not others and not _is_option(argument):
            current.append(argument)
        else:
            current = others
            others.append(argument)
    for key, values in texts.items():
        if not values:
            raise UserError(f"--{key}", "followed by a value", "followed by none")
    return others, {key: _one_or_list([value_of(text) for text in values]) for key, values in texts.items()}


def value_of(text: str) -> Any:
    """The TOML value that ``text`` spells, or ``text`` itself.

    >>> value_of("1e-3"), value_of("[1, 2]"), value_of("full")
    (0.001, [1, 2], 'full')
    """
    try:
        table = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return table["value"] if len(table) == 1 else text


def _is_option(argument: str) -> bool:
    if not argument.startswith("-"):
        return False
    try:
        float(argument)
    except ValueError:
        return True
    return False


def _one_or_list(values: list[Any]) -> Any:
    return values[0] if len(values) == 1 else values
