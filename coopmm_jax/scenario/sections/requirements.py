"""The section [requirements] of a scenario: limits that metrics have to keep, and sentences over signals.

    [requirements]
    force_error_rms_late = "<= 2.0"
    contact_loss_fraction = "== 0"
    keeps_pressing = "always[1.5, 20] contact_force >= 5"
    settles = { require = "eventually[0, 3] always tracking_error <= 0.01", scale = 0.005, hard = true }

The robustness of a sentence stands among the metrics under the sentence's name: it is met where that is not negative.

>>> import numpy as np
>>> RequirementsSection.model_validate({"force_min": ">= 0"}).parsed()[0].met(np.array([1.0, -1.0]))
array([ True, False])
"""

from __future__ import annotations

import functools
import math
import operator
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field, model_validator

from coopmm_jax.algebra.later import jnp
from coopmm_jax.errors import UserError, one_line
from coopmm_jax.metrics.table import METRICS, Metric
from coopmm_jax.scenario.fields import Finite, Flag, Section, quantity
from coopmm_jax.scenario.validation import validate
from coopmm_jax.temporal_logic.grammar import read
from coopmm_jax.temporal_logic.sentence import Numbers, Sentence, Sentences, stand_in
from coopmm_jax.temporal_logic.signals import typical_size

_OPERATORS = {"<=": operator.le, ">=": operator.ge, "==": operator.eq, "<": operator.lt, ">": operator.gt}
_FORM = re.compile(rf"\s*({'|'.join(_OPERATORS)})\s*(\S+)\s*")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_TAKEN = ("completed",)  # stands beside requirements in every table
_SHOWN = 90  # characters of a sentence in tables


def relations() -> tuple[str, ...]:
    """Forms of a limit."""
    return tuple(_OPERATORS)


class Requirement(NamedTuple):
    """A metric, and the limit it has to keep; of a sentence, its robustness and zero."""

    metric: str  # or the sentence's name
    relation: str  # of _OPERATORS
    limit: float
    scale: float = 1.0  # what its robustness is divided by, in the metric's unit
    hard: bool = False  # whether tuning has to keep it
    sentence: Sentence | None = None

    def met(self, values: Any) -> Any:
        """True if a value keeps the limit, or booleans for many (N,); one that is not a number does not."""
        return _OPERATORS[self.relation](values, self.limit)

    def robustness(self, values: Any) -> Any:
        """Distance of values (...,) from the limit, in units of the scale; negative where they break it."""
        over = values - self.limit
        if self.relation == "==":
            return -abs(over) / self.scale
        return (over if self.low_is_bad else -over) / self.scale

    @property
    def low_is_bad(self) -> bool:
        """True if the worst value is the smallest."""
        return self.relation.startswith(">")

    @property
    def short(self) -> str:
        """Name of a sentence, metric and limit of another requirement."""
        return self.metric if self.sentence else str(self)

    def __str__(self) -> str:
        if self.sentence:
            return f"{self.metric}: {one_line(self.sentence.text, _SHOWN)}"
        return f"{self.metric} {self.relation} {self.limit:g}"


Scale = Annotated[Finite, Field(ge=1e-30, le=1e30)]  # what is divided by it stays far from the ends of numbers


class RequirementSection(Section):
    """One requirement with all that can be said of it."""

    label: ClassVar[str] = "one of require, scale and hard"  # for errors

    require: str = quantity(..., 'a metric\'s limit, as "<= 2.0", or a sentence')
    scale: Scale | None = quantity(None, "what its robustness is divided by, in the metric's or sentence's unit")
    hard: Flag = quantity(False, "whether tuning has to keep it: hard or soft")


class RequirementsSection(Section, extra="allow"):
    """[requirements]: metric = "<= limit" (or >=, ==, <, >), name = "sentence over signals"; "none" drops a base's."""

    # pydantic checks the fields that are allowed against this type
    __pydantic_extra__: dict[str, str | RequirementSection] = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        init=False
    )

    @model_validator(mode="before")
    @classmethod
    def _table(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            raise UserError("", 'a table of metric = "<= limit"', data)
        kept = {name: _described(name, given) for name, given in data.items() if given != "none"}
        for name, given in kept.items():
            parse(name, given)
        return kept

    def parsed(self) -> tuple[Requirement, ...]:
        """The lines in the order of the file."""
        return tuple(parse(name, given) for name, given in self.__pydantic_extra__.items())

    def sentences(self) -> Sentences:
        """Sentences among them, as a rollout takes them."""
        read = [(each, each.sentence) for each in self.parsed() if each.sentence]
        return Sentences(
            tuple((each.metric, sentence.form) for each, sentence in read),
            tuple(Numbers(sentence.numbers, each.scale) for each, sentence in read),
        )

    def metrics(self) -> dict[str, Metric]:
        """Everything that is measured of a rollout by name: the metrics, then the robustness of the sentences."""
        own = ((each.metric, each.sentence) for each in self.parsed() if each.sentence)
        about = (Metric(name, read.unit, f"robustness of {read.text}", "", "") for name, read in own)
        return {**METRICS, **{metric.name: metric for metric in about}}


def _described(name: str, given: Any) -> Any:
    """A requirement's table, checked; a text as it is."""
    if not isinstance(given, Mapping):
        return given
    try:
        return validate(RequirementSection, given)
    except UserError as error:
        raise UserError(f"{name}.{error.field}", error.must, error.was) from None


def parse(name: str, given: Any) -> Requirement:
    """One line of the section.

    Args:
        name: of a metric, or of the sentence.
        given: text, or a table.

    Raises:
        UserError: of a metric, the text is not a relation and a number; of another name, no sentence.

    >>> str(parse("force_min", ">=0")), str(parse("presses", "always contact_force >= 0"))
    ('force_min >= 0', 'presses: always contact_force >= 0')
    """
    described = given if isinstance(given, RequirementSection) else None
    place, text = (f"{name}.require", described.require) if described else (name, given)
    if name in METRICS or (isinstance(text, str) and text.strip()[:1] in ("<", ">", "=")) or not isinstance(text, str):
        found = _limit(name, place, text)
    else:
        found = _sentence(name, place, text)
    if described is None:
        return found
    return found._replace(scale=described.scale or found.scale, hard=described.hard)


def _limit(metric: str, place: str, text: Any) -> Requirement:
    match = _FORM.fullmatch(text) if isinstance(text, str) else None
    try:
        limit = float(match[2]) if match else math.nan
    except ValueError:
        limit = math.nan
    if match is None or not math.isfinite(limit):
        must = f'one of {", ".join(_OPERATORS)} and a number, as in "<= 2.0"'
        raise UserError(place, must, f'"{text}"' if isinstance(text, str) else text)
    unit = METRICS[metric].unit if metric in METRICS else "-"
    return Requirement(metric, match[1], limit, abs(limit) or typical_size(unit))


@functools.lru_cache(maxsize=256)
def _sentence(name: str, place: str, text: str) -> Requirement:
    if name in _TAKEN:
        raise UserError(place, f"a sentence under another name than {name}, which stands in every table", name)
    if not _NAME.fullmatch(name):
        raise UserError(place, "named by a metric, or a sentence under a name of letters, digits and _", name)
    sentence = read(text, place)
    return Requirement(name, ">=", 0.0, sentence.scale, sentence=sentence)


def robustness(requirements: Sequence[Requirement], metrics: Mapping[str, Any], completed: Any, survived: Any) -> Any:
    """Distance of each of n requirements from being broken, in units of its scale: an array (..., n).

    Args:
        requirements: of the scenario.
        metrics: by name, arrays (...,), those of sentences among them; NumPy's, JAX's, or traced.
        completed: whether the rollouts reached their horizon (...,).
        survived: share of the horizon before a failure (...,): a rollout that fails gets -1e6 to -2e6.

    >>> float(robustness([parse("force_max", "<= 50")], {"force_max": 40.0}, True, 1.0)[0])
    0.2
    """
    failed = stand_in(survived)
    found = (jnp.where(completed, each.robustness(metrics[each.metric]), failed) for each in requirements)
    return jnp.stack(list(found), axis=-1)
