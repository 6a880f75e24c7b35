"""The page on controllers, whose commands ``test_pages.py`` carries out, and what is said of ones that are wrong."""

import re
from pathlib import Path

import pytest

import coopmm_jax as cm
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import registry
from tests import plugin_page

PAGE = Path(__file__).parent.parent / "docs" / "controllers.md"
TEXT = PAGE.read_text(encoding="utf-8")
((NAME, SOURCE),) = plugin_page.files(TEXT).items()


def test_controller_of_the_page_takes_forty_lines():
    assert len(list(filter(str.strip, SOURCE.splitlines()))) <= 40


# What is changed in the page's controller, and what is said of it when a scenario is loaded.
WRONG = {
    ("return State((zero,)", "return State(('none',)"): "start: must be a pytree of numbers, its state, was State(",
    ("(zero,) * freedom.rows", "(zero,) * freedom.row"): (
        "start: must be free of errors, was AttributeError: 'Freedom' object has no attribute 'row'"
    ),
    ("zip(self.P, ", "zip(self.stiffness, "): (
        "command: must be free of errors, was AttributeError: 'PdPlus' object has no attribute 'stiffness'"
    ),
    ("e = joint_errors(seen)", "e = joint_errors(seen) if seen.t > 0 else None"): (
        "command: must be free of errors, was TracerBoolConversionError"
    ),
    ("return Command(force, State, ", "return (force, State, "): (
        "command: must be a Command(force, rates, signals), was (((number, number,"
    ),
    ("return Command(force, ", "return Command(force[0], "): (
        "command: force: must be a pair of tuples of 5 numbers, F on all joints, was (number, number,"
    ),
    ("Command(force, State,", "Command(force, State(force),"): "command: rates: must be a function of the force error",
    ("Command(force, State,", "Command(force, lambda error: State(error[:2]),"): (
        "command: rates: must be of the form of its state, State(force_integral=(number, number, number, number)), was "
        "State(force_integral=(number, number))"
    ),
    ("Command(force, State,", "Command(force, lambda error: State(error[4]),"): (
        "command: rates: must be free of errors, was IndexError: tuple index out of range"
    ),
    ('{"position_error": e.position}', "{}"): (
        "signals: position_error: must be among the signals of the command, or a field of the state, was neither"
    ),
    ('{"position_error": e.position}', '{"position_error": e.position[0]}'): (
        "signals: position_error: must be a tuple of 6 numbers, was number"
    ),
    ("return pi_feedback(self.K_lambda, self.K_I, ", "return (self.K_lambda, "): (
        "force_feedback: must be a ForceFeedback of two tuples of 4 numbers, was ((number"
    ),
    ("self.K_lambda, self.K_I", "self.K_lambda[:1], self.K_I"): (
        "force_feedback: must be a ForceFeedback of two tuples of 4 numbers, was ForceFeedback(proportional=(number,),"
    ),
    ("    def start(", "    def estimates(self, state):\n        return state\n\n    def start("): (
        "estimates: must be a tuple of numbers, was State("
    ),
}
# The same, of what is said when the plugin is loaded.
REFUSED = {
    ("    def force_feedback(", "    def feedback("): "must be a class with def force_feedback(self, state)",
    (")] = 5.0", ")]"): "k2: must be a gain with a default: one number, or a tuple of equal ones, was without",
    ("(200.0,) * 6", "(1.0, 2.0)"): "P: must be a gain with a default: one number, or a tuple of equal ones, was (1.0",
    ("(0.05, 100.0)", "(100.0, 0.05)"): "k2: must be bounds of a search, low and high, above 0, was [100.0, 0.05]",
    ('lateral = "k2"', 'lateral = "k1"'): "lateral: must be some of its gains (k2, P, D, K_lambda, K_I), was k1",
    ('lateral = "k2"', 'lateral = "P"'): "lateral: must be a gain that is one number, was P",
    ('"independent")}', '"joint")}'): "position_error: must be a Signal whose entries belong to one of independent",
}


def changed(place, change):
    before, after = change
    assert SOURCE.count(before) == 1
    (place / NAME).write_text(SOURCE.replace(before, after), encoding="utf-8")
    return place / NAME


@pytest.mark.parametrize(("change", "message"), WRONG.items(), ids=[str(i) for i in range(len(WRONG))])
def test_controller_that_cannot_be_used_is_one_line(registered, tmp_path, change, message):
    cm.load_plugin(changed(tmp_path, change))
    with pytest.raises(UserError) as caught:
        cm.load_scenario("paper", law={"controller": "pd_plus"})
    assert str(caught.value).startswith(f'plugin {NAME}: controller "pd_plus": {message}')


@pytest.mark.parametrize(("change", "message"), REFUSED.items(), ids=[str(i) for i in range(len(REFUSED))])
def test_controller_that_cannot_be_loaded_is_one_line(registered, tmp_path, change, message):
    with pytest.raises(UserError) as caught:
        cm.load_plugin(changed(tmp_path, change))
    assert str(caught.value).startswith(f'plugin {NAME}: controller "pd_plus": {message}')


@pytest.mark.parametrize("scenario", ["paper", "free", "ellipse", "compliant"])
def test_controller_of_the_page_can_be_used_in_any_loop(registered, tmp_path, scenario):
    (tmp_path / NAME).write_text(SOURCE, encoding="utf-8")
    cm.load_plugin(tmp_path / NAME)
    assert cm.load_scenario(scenario, law={"controller": "pd_plus"}).law.controller == "pd_plus"


def test_the_page_names_all_shipped_controllers():
    shipped = {name for name, kind in registry.known("controller").items() if kind.plugin is None}
    table, _, _ = TEXT.partition("## A controller of your own")
    assert set(re.findall(r"^\| `(\w+)` \|", table, flags=re.MULTILINE)) == shipped
