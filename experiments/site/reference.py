"""The reference, made of the code: fields, kinds, metrics, distributions, cost, commands and the Python interface."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Iterator
from typing import Any

import coopmm_jax
import tuning
from coopmm_jax import cli
from coopmm_jax.commands.fields import shown
from coopmm_jax.kinds import cost_terms, registry
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.scenario import catalogue
from coopmm_jax.scenario.catalogue import NOT_GIVEN, Entry
from coopmm_jax.scenario.sections.requirements import relations
from coopmm_jax.scenario.sections.uncertainty import Distribution, shapes
from coopmm_jax.temporal_logic import grammar
from coopmm_jax.temporal_logic.signals import SIGNALS

_FIELDS = ("field", "unit", "default", "meaning")
_GROUPS = ("controller", "path", "timing", "course", "surface", "disturbance")


def pages() -> dict[str, str | bytes]:
    """Pages by path."""
    return {
        "reference/fields.md": fields(),
        "reference/kinds.md": kinds(),
        "reference/metrics.md": metrics(),
        "reference/signals.md": signals(),
        "reference/uncertainty.md": uncertainty(),
        "reference/cost.md": cost(),
        "reference/commands.md": commands(),
        "reference/python.md": python(),
    }


def table(header: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    r"""Table in Markdown.

    >>> table(("a", "b"), [(1, "x | y")])
    '| a | b |\n| --- | --- |\n| 1 | x \\| y |\n'
    """
    header = tuple(header)
    cells = (header, ("---",) * len(header), *rows)
    return "".join(f"| {' | '.join(_cell(cell) for cell in row)} |\n" for row in cells)


def fields() -> str:
    """Every section of a scenario with its fields."""
    parts = [
        "# Fields of a scenario\n\nA scenario file is TOML; what it leaves out has the default, or the value of its "
        '`base = "..."`. On the command line the field `plant.m_p` is `--plant.m-p`; `coopmm help plant --scenario '
        "sensed` prints a section with a scenario's own values. A field that takes a pair also takes one number for "
        "both robots, one with an entry for each row or velocity one number for all.\n"
    ]
    told: dict[str, str] = {}
    for name, title in catalogue.sections().items():
        parts.append(f"## {name}\n\n{_sentence(title)}\n\n{_of_section(name, told)}")
    return "\n".join(parts)


def kinds() -> str:
    """Groups of kinds with the kinds of each."""
    parts = [
        "# Kinds\n\nSections with a field `kind` describe one of these; a [plugin](../plugins.md) can add others. "
        "Their fields are in [Fields of a scenario](fields.md).\n"
    ]
    for group in _GROUPS:
        known = registry.known(group)
        rows = ((f"`{name}`", " ".join((kind.made.__doc__ or "").split())) for name, kind in known.items())
        parts.append(f"## {group}\n\n{_capital(registry.GROUPS[group].meaning)}.\n\n{table(('kind', 'meaning'), rows)}")
    return "\n".join(parts)


def metrics() -> str:
    """Every metric with its unit and meaning."""
    rows = ((f"`{m.name}`", m.unit, m.meaning, "late" if m.window != "whole" else "") for m in METRICS.values())
    return (
        "# Metrics\n\nMeasured inside every rollout, at each step: `coopmm metrics` prints this table. Each can be "
        "required. The late window is the last quarter of the horizon. What a rollout that fails did not live to see "
        f"is NaN.\n\n{table(('metric', 'unit', 'meaning', 'window'), rows)}"
    )


def signals() -> str:
    """Every signal with its unit and meaning, and the grammar of sentences."""
    rows = ((f"`{signal.name}`", signal.unit, signal.meaning) for signal in SIGNALS.values())
    rules = (grammar.__doc__ or "").partition("\n\n")[2].partition("\n\nWhat stands")[0]
    return (
        "# Signals and sentences\n\nA sentence in `[requirements]` speaks of these numbers, which every rollout has at "
        "each step: `coopmm metrics` prints this table. [A requirement of your own](../howto/own_requirement.md) has "
        f"examples.\n\n{table(('signal', 'unit', 'meaning'), rows)}\n## Grammar\n\n{rules}\n\n"
        "`always` and `eventually` bind what follows next; `and` binds more tightly than `or`, and that than "
        "`implies`. `<` and `>` are read as `<=` and `>=`."
    )


def uncertainty() -> str:
    """Distributions, and forms of a requirement."""
    forms = ((f"`{name}`", ", ".join(f"`{number}`" for number in numbers)) for name, numbers in shapes().items())
    options = ((f"`{name}`", info.description) for name, info in Distribution.model_fields.items() if info.description)
    limits = ((f"`{relation}`", f'`force_min = "{relation} 0.5"`') for relation in relations())
    return (
        "# Distributions and requirements\n\n## Distributions\n\nA line of `[uncertainty]` names a number of the "
        "scenario and says how it varies from sample to sample:\n\n```toml\n[uncertainty]\n"
        '"plant.masses" = { distribution = "uniform", low = 0.8, high = 1.2, relative = true }\n'
        '"sensing.force_lag" = { distribution = "log_uniform", low = 0.001, high = 0.02 }\n```\n\n'
        "`plant.masses` stands for all masses and inertias; `plant.m_p.1` is robot I's alone; "
        '`{ distribution = "none" }` drops what a base says.\n\n'
        f"{table(('distribution', 'numbers'), forms)}\n{table(('option', 'meaning'), options)}\n"
        "## Requirements\n\nA line of `[requirements]` names a [metric](metrics.md) and the limit that every sample "
        'has to keep; `"none"` drops a base\'s. A line of another name is a sentence over [signals](signals.md).\n\n'
        f"{table(('relation', 'example'), limits)}"
    )


def cost() -> str:
    """Terms of the tuner's cost."""
    terms = (
        (f"`{name}`", kind.made.unit, kind.made.weight, kind.made.__doc__) for name, kind in cost_terms.terms().items()
    )
    return (
        "# The tuner's cost\n\nA weighted sum of these terms, each divided by its value under the scenario's own "
        "gains: `[tuning.weights]` has the weights. A [plugin](../plugins.md) can add terms.\n\n"
        f"{table(('term', 'unit', 'weight', 'meaning'), terms)}"
    )


def commands() -> str:
    """Help of every command, without the fields that any of them can override."""
    parser = cli._parser([])
    found = next(action for action in parser._actions if isinstance(action, argparse._SubParsersAction)).choices
    head = (
        "# Commands\n\nAny field of a scenario can be given as `--section.field VALUE` to a command that takes a "
        "scenario. Exit codes: 0 done, 2 the input cannot be used, 3 a rollout failed. Results that are there already "
        "are replaced only with `--overwrite`.\n\n"
        f"```text\n{parser.format_help()}```\n"
    )
    parts = [f"## coopmm {name}\n\n```text\n{_short(command)}```\n" for name, command in found.items()]
    return "\n".join([head, *parts])


def python() -> str:
    """The Python interface: what ``import coopmm_jax as cm`` and ``import tuning`` have, each once."""
    parts = ["# Python\n\n    import coopmm_jax as cm\n    import tuning\n"]
    shown: set[str] = set()
    for package, title in ((coopmm_jax, "coopmm_jax"), (tuning, "tuning")):
        parts.append(f"## {title}\n")
        for name in package.__all__:
            made = getattr(package, name)
            place = f"{made.__module__}.{made.__name__}"
            if place not in shown:
                shown.add(place)
                own = f"    options:\n      heading: {name}\n      toc_label: {name}\n" if made.__name__ != name else ""
                parts.append(f"::: {place}\n{own}")
    return "\n".join(parts)


def _of_section(name: str, told: dict[str, str]) -> str:
    """Tables of a section: its own fields, then those of each kind below its name."""
    parts: list[str] = []
    rows: list[Entry] = []

    def flush() -> None:
        if rows:
            parts.append(table(_FIELDS, map(_row, rows)))
            rows.clear()

    for entry in catalogue.entries(name, told):
        if entry.heading:
            flush()
            parts.append(f"**{entry.kind}**: {entry.text.removeprefix(f'[gains] of {entry.kind}: ')}\n")
        else:
            rows.append(entry)
    flush()
    if not parts:
        parts.append("See [Distributions and requirements](uncertainty.md).\n")
    return "\n".join(parts)


def _row(entry: Entry) -> Iterator[str]:
    meaning = entry.meaning + (f": {' or '.join(f'`{choice}`' for choice in entry.choices)}" if entry.choices else "")
    if entry.as_well:
        meaning += f", with the fields of `{entry.as_well}`"
    yield f"`{entry.place}`"
    yield entry.unit
    yield "given" if entry.default is NOT_GIVEN else shown(entry.default, entry.place)
    yield meaning


def _short(command: argparse.ArgumentParser) -> str:
    text = command.format_help()
    return re.sub(r"\noverrides, after SCENARIO.*", "", text, flags=re.DOTALL)


def _sentence(title: str) -> str:
    head, _, rest = title.partition(": ")
    return _capital(rest.replace("``", "`")) if head.startswith("[") else title


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _cell(value: Any) -> str:
    text = f"{value:g}" if isinstance(value, float) else " ".join(str(value).split())
    return text.replace("``", "`").replace("|", "\\|")
