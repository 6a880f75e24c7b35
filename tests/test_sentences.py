"""Sentences: their robustness against the definition, exact and smooth, while a rollout goes on and afterwards."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.errors import UserError
from coopmm_jax.temporal_logic import monitor
from coopmm_jax.temporal_logic import robustness as robust
from coopmm_jax.temporal_logic.grammar import LONGEST, read
from coopmm_jax.temporal_logic.robustness import robustness
from coopmm_jax.temporal_logic.sentence import signals_of
from tests.oracles import temporal_logic

COUNT, LAST, STEP = 14, 11, 0.5  # samples that there is room for, the last of the run, [s]
RANDOM = 400


def drawn(seed, count):
    """Random sentences, each as a tuple, as read, with signals, and with its robustness by definition."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        names = rng.choice(list(temporal_logic.UNITS), 2 if rng.random() < 0.5 else 3, replace=False)
        sentence = temporal_logic.draw(rng, int(rng.integers(0, 4)), names)
        signals = temporal_logic.traces(rng, COUNT)
        found.append((sentence, read(temporal_logic.text(sentence)), signals))
    return found


def ran(sentence, signals):
    """Robustness as it is gathered sample by sample."""
    numbers = np.array(sentence.numbers)
    known = monitor.unwatched(sentence.form, jnp.zeros(()))
    for i in range(LAST + 1):
        now = {name: signals[name][i] for name in signals_of(sentence.form)}
        known = monitor.watch(sentence.form, known, i, STEP, now, numbers)
    return float(monitor.robustness_of(sentence.form, known))


def looked_at(sentence, signals, temperature=None):
    """Robustness from all samples."""
    given = {name: np.asarray(signals[name]) for name in signals_of(sentence.form)}
    return robustness(sentence.form, given, np.array(sentence.numbers), STEP, LAST, temperature)


@pytest.fixture(autouse=True)
def loops_compiled_once(monkeypatch):
    """Most sentences have the same loops; outside a compiled program each would be compiled where it stands."""
    monkeypatch.setattr(robust, "smooth", functools.cache(robust.smooth))
    for name, fixed in (("_sliding", 3), ("_from_the_back", 0)):
        monkeypatch.setattr(robust, name, jax.jit(getattr(robust, name), static_argnums=fixed))


def test_random_sentences_are_as_defined():
    kinds = {"running": 0, "afterwards": 0, "beyond": 0}
    for tree, sentence, signals in drawn(1, RANDOM):
        expected = temporal_logic.robustness(tree, signals, STEP, LAST)
        if expected is None:
            kinds["beyond"] += 1
            assert sentence.reach() > STEP * (
                LAST - 3
            )  # windows are rounded to samples, at most three inside each other
            continue
        assert float(looked_at(sentence, signals)) == pytest.approx(expected, rel=1e-12, abs=1e-12), sentence.text
        kinds["afterwards"] += 1
        if not monitor.needs_samples(sentence.form):
            kinds["running"] += 1
            assert ran(sentence, signals) == pytest.approx(expected, rel=1e-12, abs=1e-12), sentence.text
    assert kinds["afterwards"] > 0.9 * RANDOM, kinds
    assert kinds["running"] > 0.3 * RANDOM, kinds


def test_smooth_robustness_converges_to_the_exact_one():
    widest = 0.0
    for _, sentence, signals in drawn(2, 60):
        if sentence.reach() > STEP * (LAST - 3):
            continue
        exact = float(looked_at(sentence, signals))
        errors = [abs(float(looked_at(sentence, signals, t)) - exact) for t in (1e-1, 1e-2, 1e-5)]
        # Each of at most seven extremes inside each other, of at most 12 samples, adds the temperature times log 12.
        assert all(error <= 7 * t * np.log(12) for error, t in zip(errors, (1e-1, 1e-2, 1e-5), strict=True)), (
            sentence.text
        )
        widest = max(widest, errors[0])
    assert widest > 0.05  # smooth is not the same as exact


def test_smooth_gradients_are_those_of_differences():
    rng = np.random.default_rng(4)
    checked = 0
    for _, sentence, signals in drawn(3, 12):
        if sentence.reach() > STEP * (LAST - 3):
            continue
        given = {name: np.asarray(signals[name]) for name in signals_of(sentence.form)}
        tolerances = np.array([label is not None for label in sentence.labels])
        numbers = np.array(sentence.numbers)

        def value(given, numbers, sentence=sentence):
            return robustness(sentence.form, given, numbers, STEP, LAST, 0.3)

        slopes = jax.grad(value, (0, 1))(given, numbers)
        way = jax.tree.map(lambda x: rng.normal(size=x.shape), (given, numbers))
        way = (way[0], np.where(tolerances, way[1], 0.0))
        ends = [jax.tree.map(lambda x, d, h=h: x + h * d, (given, numbers), way) for h in (-1e-5, 1e-5)]
        difference = (value(*ends[1]) - value(*ends[0])) / 2e-5
        slope = sum(np.vdot(a, b) for a, b in zip(jax.tree.leaves(slopes), jax.tree.leaves(way), strict=True))
        assert float(slope) == pytest.approx(float(difference), rel=1e-6, abs=1e-7), sentence.text
        checked += 1
    assert checked > 8


FAULTS = {
    "": 'a sentence over signals, as "always[0.5, 20] contact_force >= 5", was empty',
    "contact_force": "a condition, as contact_force >= 5, at column 1, was contact_force",
    "always": "a number or a signal at column 7, was its end",
    "always contact_force": "a condition, as contact_force >= 5, at column 8, was contact_force",
    "contact_force >= ": "a number or a signal at column 18, was its end",
    "contact_force => 5": "a name, a number or a sign at column 15, was =",
    "contct_force >= 5": "a number or a signal at column 1 (did you mean contact_force?), was contct_force",
    "xyzzy >= 5": "a number or a signal at column 1 (coopmm metrics lists signals, --plugin adds some), was xyzzy",
    "contact_force >= 5 5": "the end of the sentence, or and, or, implies, until at column 20, was 5",
    "(contact_force >= 5": ") or more of the sentence at column 20, was its end",
    "contact_force >= 5)": "the end of the sentence, or and, or, implies, until at column 19, was )",
    "always[1 contact_force >= 5": "a comma between begin and end of the window at column 10, was contact_force",
    "always[1, 2 contact_force >= 5": "] after the window at column 13, was contact_force",
    "always[, 2] t >= 5": "the window's begin, a number of seconds from 0 on, at column 8, was ,",
    "always[1, ] t >= 5": "the window's end, a number of seconds or inf, at column 11, was ]",
    "always[2, 1] t >= 5": "the window's end, not before its begin 2, at column 11, was 1",
    "always[-1, 2] t >= 5": "the window's begin, a number of seconds from 0 on, at column 8, was -",
    "always[inf, inf] t >= 5": "the window's begin, a number of seconds from 0 on, at column 8, was inf",
    "3 >= 2": "a comparison with a signal at column 1, was 3",
    "t >= 1e999": "a finite number at column 6, was 1e999",
    "t * t >= 1": "a number, since only one factor can have a signal, at column 5, was t",
    "t / 0 >= 1": "a number other than 0 below a fraction at column 5, was 0",
    "t / (1 - 1) >= 1": "a number other than 0 below a fraction at column 5, was (",
    "contact_force[1] >= 1": "no [ after contact_force at column 14, was [",
    "torque[joint_1] >= 1": "no [ after torque at column 7 (did you mean torque_1 or torque_2?), was [",
    "t >= 1 until t >= 2 until t >= 3": "the end of the sentence, or and, or, implies, until at column 21 "
    "(until takes parentheses: (a until b) until c), was until",
    "t >= 1e31": "0 or from 1e-30 to 1e+30 in size at column 6, was 1e31",
    "t >= 1e-31": "0 or from 1e-30 to 1e+30 in size at column 6, was 1e-31",
    "1 / t >= 1": "a number other than 0 below a fraction at column 5, was t",
    "abs t >= 1": "( after abs at column 5, was t",
    "abs(t >= 1) >= 1": "a number or a signal at column 5, was t",
    "torque_1 >= 5": "[ after torque_1, as in torque_1[right_wheel], at column 10, was >=",
    "torque_1[joint_9] >= 5": "one of right_wheel, left_wheel, joint_1, joint_2, joint_3 at column 10, was joint_9",
    "torque_1[joint_1 >= 5": "] after torque_1[joint_1 at column 18, was >=",
    "t >= 1 and": "a number or a signal at column 11, was its end",
    "t >= 1 and t": "a condition, as contact_force >= 5, at column 12, was t",
    "t implies t >= 1": "a condition, as contact_force >= 5, at column 1, was t",
    "not t": "a condition, as contact_force >= 5, at column 5, was t",
    "t >= 1 until t": "a condition, as contact_force >= 5, at column 14, was t",
    "(t >= 1) + 2 >= 1": "a number or a signal at column 1, was (",
    "t >= and": "a number or a signal at column 6, was and",
    "t >= 1; t >= 2": "a name, a number or a sign at column 7, was ;",
    "t \N{GREATER-THAN OR EQUAL TO} 1": "a name, a number or a sign at column 3, was \N{GREATER-THAN OR EQUAL TO}",
    "(" * 50 + "t >= 1" + ")" * 50: "at most 40 parts inside each other at column 42, was (",
    "t >= 1" + " and t >= 1" * 60: f"a sentence of at most {LONGEST} characters, was one of 666",
}


@pytest.mark.parametrize("text", FAULTS, ids=range(len(FAULTS)))
def test_a_bad_sentence_is_told_in_one_line_with_its_place(text):
    with pytest.raises(UserError) as error:
        read(text, "requirements.mine")
    assert str(error.value) == f"requirements.mine: must be {FAULTS[text]}"


def test_random_text_is_read_or_refused():
    rng = np.random.default_rng(5)
    characters, refused = list('[](),+-*/<>=1.e \n"abt\u00e9'), 0
    for _ in range(1000):
        tree = temporal_logic.draw(rng, 2, ["contact_force", "torque_1[joint_2]"])
        text = list(temporal_logic.text(tree))
        for _ in range(rng.integers(1, 4)):
            at = rng.integers(len(text))
            text[at : at + rng.integers(0, 3)] = rng.choice(characters, rng.integers(0, 2)).tolist()
        try:
            read("".join(text))
        except UserError as error:
            refused += 1
            told = str(error)
        else:
            told = ""
        assert "\n" not in told
        assert len(told) < 460
    assert 500 < refused < 1000
