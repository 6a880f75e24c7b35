"""Docstrings: everything public has one, they say shapes, units, errors and equations, and their examples run."""

import ast
import doctest
import importlib
from pathlib import Path

import pytest

from tests import equation_map
from tests.docstring_rules import complaints, definitions, equations, numbers, parsed, wording

ROOT = Path(__file__).parent.parent
PACKAGES = ("coopmm_jax", "experiments", "tuning")
SOURCES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text(encoding="utf-8")
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
    if path.stem != "__init__"
}
EXAMPLES = [module for module, source in SOURCES.items() if ">>> " in source]

BAD = '''
"""A module on (3) and (5)-(7)."""

def bare(x): pass

def numbers(x: np.ndarray, t: float | None = None):
    """No word on either."""

def shaped(x: np.ndarray) -> Vector:
    """Of x (n, 3)."""

def measured(t: Scalar):
    """At t [s]."""

def raising(name: str):
    """Says nothing."""
    raise UserError("name", "known", name)

def through(name: str):
    """Says nothing."""
    _check(name)

def honest(name: str):
    """Says it.

    Raises:
        UserError: an unknown name.
    """
    _check(name)

def catching(name: str):
    """Raises nothing."""
    try:
        _check(name)
    except UserError:
        print(name)

def _check(name): _really(name)
def _really(name): raise UserError("name", "known", name)

class Public:
    """Vectors are (n,)."""

    @property
    def bare(self): return 0

    def numbers(self, x: np.ndarray):
        """The class says which."""

class _Private:
    def anything(self): pass
'''

BADLY_WORDED = '''
"""What a module holds."""

def together(x, y):
    """Sum of both.

    Args:
        x: one. y: the other.
    """

def grouped(x, y):
    """Sum of both.

    Args:
        x, y: numbers.
    """

def unknown(x, *more, **options):
    """Sum of all.

    Args:
        x: a number, or a time: then with its unit,
            y: like this.
        more: likewise.
        options: likewise.
        z: the last.
    """

def _hidden(x):
    """Whether x is hidden."""
'''


def test_the_rules_find_what_is_wrong():
    found = definitions("bad", BAD)
    said = [complaint for definition in found for complaint in complaints(definition)]
    assert [complaint.split(":")[0] for complaint in said] == [
        "bad.bare",
        "bad.numbers",
        "bad.raising",
        "bad.through",
        "bad.Public.bare",
    ]
    raising = [definition.name for definition in found if definition.raises]
    assert raising == ["bad.raising", "bad.through", "bad.honest"]
    assert equations(BAD) == {3, 5, 6, 7}


def test_the_rules_find_what_is_badly_worded():
    said = wording("bad", BADLY_WORDED)
    assert [complaint.split(": ")[:2] for complaint in said] == [
        ["bad", "begins like a question, not with a verb or a noun"],
        ["bad.together", "several arguments on one line"],
        ["bad.grouped", "below Args, not one of its arguments and a colon"],
        ["bad.unknown", "below Args, not one of its arguments and a colon"],
        ["bad._hidden", "begins like a question, not with a verb or a noun"],
    ]


def test_docstrings_begin_with_a_verb_or_a_noun_and_list_one_argument_a_line():
    sources = {path: path.read_text(encoding="utf-8") for path in sorted((ROOT / "tests").rglob("*.py"))}
    texts = SOURCES | {f"tests.{path.stem}": text for path, text in sources.items()}
    assert [complaint for module, source in texts.items() for complaint in wording(module, source)] == []


def test_everything_public_has_a_docstring_that_says_shapes_units_and_errors():
    found = [definition for module, source in SOURCES.items() for definition in definitions(module, source)]
    assert len(found) > 400
    assert sum(definition.raises for definition in found) > 30
    assert [complaint for definition in found for complaint in complaints(definition)] == []


def test_every_module_says_what_it_is():
    assert [module for module, source in SOURCES.items() if not ast.get_docstring(parsed(source))] == []


@pytest.mark.parametrize("module", equation_map.EQUATIONS)
def test_equations_are_named_where_they_are_implemented(module):
    listed, _ = equation_map.EQUATIONS[module]
    assert equations(SOURCES[f"coopmm_jax.{module}"]) >= numbers(listed)


def test_map_of_equations_is_complete_and_the_readme_prints_it():
    listed = {number for text, _ in equation_map.EQUATIONS.values() for number in numbers(text)}
    steps_between = {3, 4, *range(25, 30)}  # (4) puts (3) into (1); (25)-(29) put (12)-(18) into (8) and (11)
    assert listed == set(range(1, 41)) - steps_between
    readme = equation_map.README.read_text(encoding="utf-8")
    assert readme == equation_map.written(readme), "python -m tests.equation_map writes it"


@pytest.mark.parametrize("module", EXAMPLES)
def test_examples_in_docstrings(module):
    assert not doctest.testmod(importlib.import_module(module)).failed


def test_most_modules_have_an_example():
    assert len(EXAMPLES) > 40
