"""Changes to a scenario: nested tables, dotted keys, and the command line's ``--section.field value``.

>>> merged({"gains": {"beta": 1.0, "K_u": 1.0}}, {"gains.beta": 2.0})
{'gains': {'beta': 2.0, 'K_u': 1.0}}
>>> split(["paper", "--gains.K-sigma", "1", "-1e-3", "--out", "results"])
(['paper', '--out', 'results'], {'gains.K_sigma': [1, -0.001]})
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path
from coopmm_jax.kinds.controllers import DEFAULT
from coopmm_jax.scenario.replaced import without_replaced
from coopmm_jax.scenario.validation import closest

DISTRIBUTION = "distribution"  # the key of a table that says how a number varies
KIND = "kind"  # the key that says what kind of thing a table describes
_DEEPEST = 20
# What TOML does not take for a number and everyone else does.
_NUMBER = re.compile(r"[+-]?(\d+\.|\.\d+|\d+\.\d*)(e[+-]?\d+)?", re.IGNORECASE)
_NAME = re.compile(r"[A-Za-z_]\w*")


def read_toml(path: str | Path, field: str) -> dict[str, Any]:
    """Tables of a TOML file that the user has named.

    Raises:
        UserError: of ``field``, where the file cannot be read or is not TOML.
    """
    file = resolve_path(path, field)
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))  # some editors begin with a byte order mark
    except OSError as error:
        raise UserError(field, "a file that can be read", f"{path} ({error.strerror})") from None
    except ValueError as error:  # of the TOML parser, which says where, or of the decoding
        raise UserError(field, "a TOML file", f"{path} ({error})") from None
    except RecursionError:
        raise UserError(field, "a TOML file", f"{path} (nested too deeply)") from None


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of ``base`` with ``changes`` laid over them: tables are merged, everything else replaced.

    A table that says what kind of thing it describes replaces one of another kind, as numbers for one robot each
    replace those for both. A key of ``changes`` with dots stands for nested tables. Over a list of tables, a table's
    keys are names or numbers of its entries, or fields of the first one. numpy's scalars and arrays become numbers and
    lists.

    Raises:
        UserError: tables in tables in tables, deeper than any scenario has them.

    >>> merged({"disturbance": [{"name": "gust", "scale": 1.0}]}, {"disturbance.gust.scale": 2.0})
    {'disturbance': [{'name': 'gust', 'scale': 2.0}]}
    """
    return _laid(base, _nested(changes))


def laid_over(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of a scenario with changes laid over them, as ``merged``.

    Another controller brings gains of its own, and what replaces fields of the base drops them.

    Raises:
        UserError: as ``merged``.

    >>> laid_over({"gains": {"gamma": 0.2}}, {"law.controller": "pid"})
    {'law': {'controller': 'pid'}}
    """
    nested = _nested(changes)
    _check_dropped(base, nested)
    before, after = _controller(base), _controller(nested)
    if after is not None and after != (before or DEFAULT):
        base = {name: table for name, table in base.items() if name not in ("gains", "schedule")}
        if isinstance(base.get("tuning"), Mapping):
            base["tuning"] = {name: value for name, value in base["tuning"].items() if name not in ("gains", "bounds")}
    result = _laid(base, nested)
    kept = without_replaced(base, result)
    return result if kept is base else _laid(kept, nested)


def _check_dropped(base: Mapping[str, Any], changes: Mapping[str, Any]) -> None:
    """Refuse to drop a requirement that is not there, as a slip of the pen would go unnoticed."""
    known, dropped = (tables.get("requirements") for tables in (base, changes))
    known = known if isinstance(known, Mapping) else {}
    for name, given in dropped.items() if isinstance(dropped, Mapping) else ():
        if given == "none" and name not in known:
            have = f"one of {', '.join(known)}, to be dropped" if known else "left out, as the base scenario has none"
            raise UserError(f"requirements.{name}", f"{have}{closest(name, known)}", '"none"')


def _controller(tables: Mapping[str, Any]) -> Any:
    law = tables.get("law")
    return law.get("controller") if isinstance(law, Mapping) else None


def _nested(changes: Mapping[str, Any], depth: int = 0) -> dict[str, Any]:
    """Changes without dots in their keys; of two that set the same the later one counts."""
    if depth > _DEEPEST:
        raise UserError(next(iter(changes), "input"), f"at most {_DEEPEST} tables deep", "deeper")
    result: dict[str, Any] = {}
    for dotted, value in changes.items():
        key, _, rest = str(dotted).partition(".")
        value = {rest: value} if rest else value
        if isinstance(value, Mapping):
            before, inner = result.get(key), _nested(value, depth + 1)
            result[key] = _combined(before, inner) if isinstance(before, dict) else inner
        else:
            result[key] = value.tolist() if hasattr(value, "tolist") else value
    return result


def _combined(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    both = dict(first)
    for key, value in second.items():
        before = both.get(key)
        both[key] = value
        if isinstance(before, Mapping) and isinstance(value, Mapping):
            both[key] = _combined(before, value)
    return both


def _laid(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in changes.items():
        before = result.get(key)
        if not isinstance(value, Mapping):
            result[key] = value
        elif isinstance(before, list | tuple) and before and all(isinstance(entry, Mapping) for entry in before):
            result[key] = _laid_over_entries(before, value)
        else:
            inner = {} if not isinstance(before, Mapping) or _replaces(value, before) else before
            result[key] = _laid(inner, value)
    return result


def _laid_over_entries(entries: Sequence[Mapping[str, Any]], changes: Mapping[str, Any]) -> list[Any]:
    by_place: dict[int, dict[str, Any]] = {}
    for key, value in changes.items():
        place = entry_of([entry.get("name") for entry in entries], key) if isinstance(value, Mapping) else None
        change = {key: value} if place is None else dict(value)
        by_place[place or 0] = by_place.get(place or 0, {}) | change
    return [
        _laid({} if _replaces(by_place.get(i, {}), entry) else entry, by_place.get(i, {}))
        for i, entry in enumerate(entries)
    ]


def entry_of(names: Sequence[Any], key: str) -> int | None:
    """Place of an entry in a list of tables, from its name or its number, counted from 1; None for neither.

    >>> entry_of(["gust", None], "gust"), entry_of(["gust", None], "2"), entry_of(["gust", None], "scale")
    (0, 1, None)
    """
    if key in names:
        return list(names).index(key)
    return int(key) - 1 if is_number(key) and int(key) <= len(names) else None


def is_number(key: str) -> bool:
    """True for the number of a robot, or of an entry of a list, counted from 1."""
    return key.isdecimal() and len(key) < 9 and int(key) >= 1


def _replaces(new: Mapping[str, Any], old: Mapping[str, Any]) -> bool:
    """True if nothing of an old table may survive in a new one."""
    if DISTRIBUTION in new or (DISTRIBUTION in old and bool(new) and all(map(is_number, new))):
        return True
    return KIND in new and new[KIND] != old.get(KIND)


def split(
    arguments: Sequence[str], takes_names: Callable[[str], bool] = lambda key: True
) -> tuple[list[str], dict[str, Any]]:
    """Take the overrides out of a command line.

    An override is ``--section.field`` (a hyphen in it stands for an underscore), then ``=value`` or a value, or several
    numbers or names up to the next option. Values are read by ``value_of``.

    Args:
        arguments: of the command line.
        takes_names: whether the field of a dotted key takes a list of names; of others, what follows a value and is
            no number is no value.

    Returns:
        The other arguments, and the overrides with dotted keys.

    Raises:
        UserError: an override without a value.
    """
    others: list[str] = []
    texts: dict[str, list[str]] = {}
    key: str | None = None  # of the override whose values are being read
    for argument in arguments:
        option, equals, text = argument.partition("=")
        if option.startswith("--") and "." in option:
            key = option[2:].replace("-", "_")
            texts[key] = [text] if equals else []
            key = None if equals else key
        elif key is not None and not _is_option(argument) and _belongs(argument, texts[key], takes_names(key)):
            texts[key].append(argument)
        else:
            key = None
            others.append(argument)
    for key, values in texts.items():
        if not values:
            raise UserError(f"--{key}", "followed by a value", "followed by none")
    return others, {key: _one_or_list([value_of(text) for text in values]) for key, values in texts.items()}


def _belongs(text: str, before: list[str], names: bool) -> bool:
    """True if a text goes on with the values of an override: ``--gains.k0 4 small.toml`` has one."""
    return not before or not isinstance(value_of(text), str) or (names and _NAME.fullmatch(text) is not None)


def value_of(text: str) -> Any:
    """The TOML value that ``text`` spells, or ``text`` itself.

    >>> value_of("1e-3"), value_of(".5"), value_of("[1, 2]"), value_of("full")
    (0.001, 0.5, [1, 2], 'full')
    """
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):  # not TOML, a whole number of thousands of digits, or a list in a list in ...
        return float(text) if _NUMBER.fullmatch(text) else text
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
