"""Signals that sentences speak of: every one has a value, the values are the run's, and plugins add some."""

from types import SimpleNamespace
from typing import NamedTuple

import jax
import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import registry
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.mechanics.coordinates import at_place
from coopmm_jax.metrics import observer
from coopmm_jax.metrics.sample import Sample, no_past, past_after, quantities
from coopmm_jax.metrics.signal_values import signal_values
from coopmm_jax.metrics.table import METRICS, registered
from coopmm_jax.parameters import Parameters, Reference, Structure
from coopmm_jax.temporal_logic.grammar import read
from coopmm_jax.temporal_logic.sentence import Numbers, Sentences
from coopmm_jax.temporal_logic.signals import AFTERWARDS, SIGNALS
from tests.oracles import control_law

KNOWN = [name for name in SIGNALS if name not in AFTERWARDS]


@pytest.mark.parametrize("name", ["paper", "eight", "mixed"])
def test_every_signal_has_a_value_for_every_kind_of_robots_and_reference(name):
    scenario = cm.load_scenario(name)
    structure, parameters = scenario.structure(), scenario.parameters()
    read_all = [read(f"always {signal} >= 0") for signal in KNOWN]
    forms = tuple((f"s{i}", each.form) for i, each in enumerate(read_all))
    about = {"duration": 1e-3, "step": 1e-3, "names": ()}
    about["sentences"] = Sentences(forms, tuple(Numbers(each.numbers, 1.0) for each in read_all))

    def robustness():
        watching = observer.observer(structure, parameters, **about)
        result = rollout(structure, parameters, 1e-3, 1, Plan.batch(1), watching)
        return observer.finish(result.total, **about, kept=result.kept)

    found = jax.eval_shape(robustness)
    assert {name: value.shape for name, value in found.items()} == {name: () for name, _ in forms}


def test_values_are_those_of_the_run(paper_run):
    t, signals = jax.tree.map(lambda x: x[::4000], (paper_run.t, paper_run.signals))
    structure, parameters = Structure(), Parameters()
    past = past_after(no_past(structure), True, signals)
    seen = quantities(structure, parameters, t, 1e-3, signals, past, past)
    values = signal_values(Sample(structure, parameters, t, 1e-3, signals, seen, {}), KNOWN)
    desired = np.moveaxis(np.array([control_law.desired_motion(Reference(), float(at))[0] for at in t]), 0, -1)
    position = np.array([[getattr(robot, name) for name in ("z1", "z2", "z3", "a1")] for robot in signals.position])
    for i in (0, 1):
        for j, entry in enumerate(("z1", "z2", "z3", "a1")):
            np.testing.assert_allclose(values[f"position_{i + 1}[{entry}]"], position[i, j])
            np.testing.assert_allclose(values[f"desired_{i + 1}[{entry}]"] + 0 * t, desired[i, j], atol=1e-9)
        heading, away = (position - desired)[i, 0], np.hypot(*(position - desired)[i, 1:3])
        np.testing.assert_allclose(values[f"heading_error_{i + 1}"], abs(heading), atol=1e-9)
        np.testing.assert_allclose(values[f"position_error_{i + 1}"], away, atol=1e-9)
        np.testing.assert_allclose(values[f"torque_{i + 1}[joint_2]"], signals.torque[i][3])
        np.testing.assert_allclose(values[f"velocity_{i + 1}[a1_rate]"], signals.velocity[i][2])
    np.testing.assert_allclose(
        values["tracking_error"], np.sqrt(((position - desired) ** 2).sum(axis=(0, 1))), atol=1e-9
    )
    np.testing.assert_allclose(values["contact_force"], signals.constraint_force[0])
    np.testing.assert_allclose(values["force_error"], values["contact_force"] - values["desired_force"])


@pytest.fixture
def plugin():
    with registry.registering("mine.py"):

        @registry.register("signal", "mine")
        class Mine(NamedTuple):
            unit = "N"
            meaning = "twice the contact force"

            def value(self, sample):
                return 2.0 * sample.quantities["contact_force"]

        @registry.register("metric", "half_of_it")
        class Half(NamedTuple):
            unit = "N"
            meaning = "largest half of the contact force"
            reduction = "max"

            def quantity(self, sample):
                return 0.5 * sample.quantities["contact_force"]

    yield Mine
    del registry.known("signal")["mine"], registry.known("metric")["half_of_it"]


def test_a_plugins_signals_and_metrics_are_spoken_of(plugin):
    assert (SIGNALS["mine"].unit, SIGNALS["half_of_it"].meaning) == ("N", "largest half of the contact force")
    assert ("mine", plugin) in registered()
    sentence = read("always mine >= 4 * half_of_it - 1")
    assert sentence.unit == "N"
    values = signal_values(SimpleNamespace(quantities={"contact_force": 6.0}), ("mine", "half_of_it"))
    assert {name: float(value) for name, value in values.items()} == {"mine": 12.0, "half_of_it": 3.0}


def test_names_of_signals_and_metrics_do_not_mix():
    assert not set(KNOWN) & set(METRICS)
    with pytest.raises(UserError, match=r"^requirements\.force_min: must be one of <=, >=, ==, <, > and a number"):
        cm.load_scenario("paper", requirements={"force_min": "always contact_force >= 0"})


# What is wrong with a requirement besides its sentence, and what is said of it.
WRONG = [
    ({"my name": "always t >= 0"}, "my name: must be named by a metric, or a sentence under a name of letters"),
    ({"completed": "always t >= 0"}, "completed: must be a sentence under another name than completed"),
    ({"late": "always[21, 30] t >= 0"}, "late: must be a sentence whose windows all begin within the 20 s of the run"),
    ({"late": {"hard": True}}, "late.require: must be given, was missing"),
    ({"late": {"require": "always t >= 0", "scale": 0.0}}, "late.scale: must be at least 1e-30, was 0.0"),
    (
        {"late": {"require": "always t >= 0", "soft": True}},
        "late.soft: must be one of require, scale and hard, was unknown",
    ),
    ({"late": {"require": "always t"}}, "late.require: must be a condition, as contact_force >= 5, at column 8, was t"),
    ({"late": 3}, "late: must be one of <=, >=, ==, <, > and a number"),
]


@pytest.mark.parametrize(("given", "said"), WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_with_a_requirement_is_one_line(given, said):
    with pytest.raises(UserError) as error:
        cm.load_scenario("paper", requirements=given)
    assert str(error.value).startswith(f"requirements.{said}")


def test_a_sentence_on_the_proof_of_another_loop_is_named():
    with pytest.raises(UserError, match=r"^requirements\.holds: scenario: must be the proof's loop: .*, was another$"):
        cm.load_scenario("sensed", requirements={"holds": "always proof_40 >= 0"})


def test_a_table_says_more_of_a_requirement():
    given = {
        "force_max": {"require": "<= 50", "hard": True},
        "presses": {"require": "always contact_force >= 5", "scale": 2.0},
        "calm": "always[1, 20] contact_force <= 40",
    }
    scenario = cm.load_scenario("paper", requirements=given)
    assert (
        cm.load_scenario("paper", **{"requirements": scenario.requirements.model_dump(exclude_none=True)}) == scenario
    )
    found = {each.metric: each for each in scenario.requirements.parsed()}
    assert {name: (each.scale, each.hard) for name, each in found.items()} == {
        "force_max": (50.0, True),
        "presses": (2.0, False),
        "calm": (40.0, False),
    }
    assert found["force_max"].robustness(np.array([40.0, 60.0])).tolist() == [0.2, -0.2]
    assert found["presses"].robustness(3.0) == 1.5
    changed = scenario.with_overrides({"requirements.presses.hard": True, "requirements.calm": "none"})
    assert [(each.metric, each.hard) for each in changed.requirements.parsed()] == [
        ("force_max", True),
        ("presses", True),
    ]


def test_joints_of_any_arm_have_signals_and_others_are_refused():
    position = at_place((0.1, 0.2, 0.3), (1.0, 2.0, 3.0, 4.0))
    per_robot = {"velocity": range(10, 16), "torque": range(20, 26), "commanded": range(30, 36)}
    signals = SimpleNamespace(position=(position,) * 2, **{name: (values,) * 2 for name, values in per_robot.items()})
    sample = SimpleNamespace(structure=SimpleNamespace(joints=(6, 6)), signals=signals)
    names = ("position_1[a4]", "velocity_2[a4_rate]", "torque_1[joint_4]", "commanded_2[joint_4]")
    values = signal_values(sample, names)
    assert [float(values[name]) for name in names] == [4.0, 15.0, 25.0, 35.0]
    four = {"bent": "always torque_2[joint_4] <= 50"}
    known = cm.load_scenario("long_arm", requirements=four)
    assert [name for name, _ in known.requirements.sentences().forms] == ["bent"]
    message = r"requirements\.bent: must be of joints that robot II has, 1 to 3, was torque_2\[joint_4\]"
    with pytest.raises(UserError, match=message):
        cm.load_scenario("paper", requirements=four)


@pytest.mark.parametrize("name", ["contact_force", "torque_1", "until", "proof_40"])
def test_a_signal_cannot_take_a_name_that_sentences_know(name, monkeypatch):
    monkeypatch.setattr(registry, "_KINDS", {group: dict(each) for group, each in registry._KINDS.items()})

    class Own(NamedTuple):
        unit, meaning = "N", "mine"

        def value(self, sample):
            return sample.t

    with pytest.raises(UserError, match=rf"must be registered under a name that means nothing .* yet, was {name}$"):
        cm.register("signal", name)(Own)
