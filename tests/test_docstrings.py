"""Docstrings: everything public has one, they say shapes, units, errors and equations, and their examples run."""

import ast
import doctest
import importlib
from pathlib import Path

import pytest

from tests.docstring_rules import complaints, definitions, equations

ROOT = Path(__file__).parent.parent
PACKAGES = ("coopmm_jax", "experiments", "tuning")
SOURCES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text(encoding="utf-8")
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
    if path.stem != "__init__"
}
EXAMPLES = [module for module, source in SOURCES.items() if ">>> " in source]

# The equations of the paper that each module implements or plots.
IMPLEMENTED = {
    "loop.closed_loop": {11, *range(12, 25)},
    "mechanics.constraints": {10},
    "control.adaptive": {19, 20, 21, 22, 23, 24},
    "control.backstepping": {12, 13, 14, 15},
    "control.controller": set(range(18, 25)),
    "control.force": {17},
    "control.motion": {8, 12, 13, 15, 17, 18, 19},
    "loop.force_loop": {15, 17},
    "mechanics.constrained_kinematics": {10},
    "mechanics.disturbance": {1},
    "mechanics.partitioning": {10, 40},
    "mechanics.constrained_dynamics": {9, 11},
    "proof.lyapunov": {31, 40},
    "parameters": set(range(12, 25)),
    "mechanics.plant": {1, 2, 11},
    "plotting.control": {15, 18, 20, 21, 22, 23, 24},
    "plotting.force": {9},
    "plotting.motion": {6},
    "proof.terms": set(range(30, 41)),
    "control.reference": {6, 12, 13},
    "mechanics.robot_kinematics": {6, 7, 8, 9},
    "mechanics.robot_dynamics": {5, 9},
}
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


def test_everything_public_has_a_docstring_that_says_shapes_units_and_errors():
    found = [definition for module, source in SOURCES.items() for definition in definitions(module, source)]
    assert len(found) > 400
    assert sum(definition.raises for definition in found) > 30
    assert [complaint for definition in found for complaint in complaints(definition)] == []


def test_every_module_says_what_it_is():
    assert [module for module, source in SOURCES.items() if not ast.get_docstring(ast.parse(source))] == []


@pytest.mark.parametrize("module", IMPLEMENTED)
def test_equations_are_named_where_they_are_implemented(module):
    assert equations(SOURCES[f"coopmm_jax.{module}"]) >= IMPLEMENTED[module]


@pytest.mark.parametrize("module", EXAMPLES)
def test_examples_in_docstrings(module):
    assert not doctest.testmod(importlib.import_module(module)).failed


def test_most_modules_have_an_example():
    assert len(EXAMPLES) > 40
