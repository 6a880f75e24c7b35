"""Scenario files: the paper's values, inheritance, overrides, and what a user is told about a bad one."""

import math
import pickle
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import ALL_ROWS, MASS_NAMES, Inertia, Parameters, Structure
from coopmm_jax.scenario.scenario import Scenario, list_scenarios, load_scenario
from coopmm_jax.scenario.sections.simulation import SimulationSection


def test_defaults_are_those_of_the_parameters():
    assert Scenario().parameters() == Parameters()
    assert Scenario().structure() == Structure()


def test_paper_spells_out_every_value_and_changes_none():
    paper = load_scenario("paper")
    assert paper.parameters() == Parameters()
    assert paper.structure() == Structure()
    assert paper.simulation == SimulationSection()
    spelt_out = paper.model_dump(exclude_unset=True)
    not_of_the_paper = {"description", "schedule", "uncertainty", "requirements", "tuning"}
    for name, section in Scenario().model_dump(exclude=not_of_the_paper, exclude_none=True).items():
        tables = section if isinstance(section, tuple) else (section,)
        spelt = spelt_out[name] if isinstance(section, tuple) else (spelt_out[name],)
        assert list(map(set, spelt)) == list(map(set, tables))


def test_uncertain_controller_underestimates_and_disturbances_grow():
    paper, uncertain = (load_scenario(name).parameters() for name in ("paper", "uncertain"))
    for true, believed in zip(paper.plant.inertia, uncertain.nominal, strict=True):
        assert believed == Inertia(*(0.8 * getattr(true, name) for name in MASS_NAMES))
    assert uncertain.disturbance == (paper.disturbance[0]._replace(scale=3.0),)
    assert uncertain._replace(nominal=paper.nominal, disturbance=paper.disturbance) == paper


def test_paper_full_differs_in_feedforward_and_floor():
    paper, full = load_scenario("paper"), load_scenario("paper_full")
    assert full.structure() == paper.structure()._replace(feedforward="full")
    gains = paper.parameters().gains._replace(delta_floor=0.1)
    assert full.parameters() == paper.parameters()._replace(gains=gains)


def test_shipped_scenarios_have_one_line_each():
    described = list_scenarios()
    assert {"free", "paper", "paper_full", "rough", "sensed", "uncertain"} | {"flat", "compliant"} <= set(described)
    assert all(line and "\n" not in line for line in described.values())


def test_pairs_and_the_object_reach_the_right_robot():
    changes = {"plant.m_p": [4, 6], "plant.m_obj": 0.7, "initial.x": [2.6, 1.1], "reference.radius": 2.0}
    parameters = Scenario().with_overrides(changes).parameters()
    assert [robot.m_p for robot in parameters.plant.inertia] == [4.0, 6.0]
    assert [robot.m_obj for robot in parameters.plant.inertia] == [0.0, 0.7]
    assert [pose.x for pose in parameters.start] == [2.6, 1.1]
    assert parameters.reference.radius == (2.0, 2.0)


def test_nominal_values_stand_and_the_rest_follows_the_plant_scaled():
    changes = {"plant.m1": [2.0, 3.0], "nominal": {"scale": 0.5, "m_p": [7.0, 8.0], "m_obj": 0.1}}
    first, second = Scenario().with_overrides(changes).parameters().nominal
    assert (first.m_p, first.m1, first.m_obj, first.I_w) == (7.0, 1.0, 0.0, 0.5)
    assert (second.m_p, second.m1, second.m_obj, second.I_w) == (8.0, 1.5, 0.1, 0.5)


@pytest.mark.parametrize(
    ("rows", "velocities"), [(ALL_ROWS, 6), (ALL_ROWS[:2], 8), ((ALL_ROWS[0], *ALL_ROWS[2:]), 7), (ALL_ROWS[:1], 9)]
)
def test_each_row_left_out_frees_one_velocity(rows, velocities):
    free = Scenario().with_overrides({"coupling.rows": list(rows)})
    gains = free.parameters().gains
    assert free.structure().rows == rows
    assert (len(gains.K_sigma), len(gains.K_lambda), len(gains.K_I)) == (velocities, len(rows), len(rows))


def test_steps():
    assert Scenario().steps == 20000
    assert Scenario().with_overrides({"simulation": {"duration": 0.3, "step": 0.1, "record_every": 3}}).steps == 3


def test_overrides_take_numpy_values_and_leave_the_original():
    original = Scenario()
    changed = original.with_overrides({"gains.K_sigma": np.arange(6.0), "gains.beta": np.float32(0.5)})
    assert changed.gains.K_sigma == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    assert changed.gains.beta == 0.5
    assert original == Scenario()
    assert hash(original) == hash(Scenario())
    assert len({original, changed}) == 2


positive = st.floats(1e-12, 1e12)


@given(
    K_sigma=st.lists(positive, min_size=6, max_size=6),
    m_p=st.tuples(positive, positive),
    phase=st.floats(allow_nan=False, allow_infinity=False),
    description=st.text(st.characters(codec="utf-8")),
)
def test_toml_round_trip_is_exact(K_sigma, m_p, phase, description):
    changes = {"gains.K_sigma": K_sigma, "nominal.m_p": m_p, "disturbance.phase": phase, "description": description}
    changed = Scenario().with_overrides(changes)
    assert Scenario.model_validate(tomllib.loads(changed.to_toml())) == changed


def test_base_is_inherited_by_name_and_by_relative_path(tmp_path):
    (tmp_path / "soft.toml").write_text('base = "uncertain"\n[gains]\nk1 = 90.0\n')
    (tmp_path / "nested").mkdir()
    (tmp_path / "nested" / "softer.toml").write_text('base = "../soft.toml"\n[gains]\nK_u = 0.5\n[nominal]\nm1 = 2\n')
    softer = load_scenario(tmp_path / "nested" / "softer.toml", gains={"K_a": 1.0})
    assert softer.description == "Based on soft"
    assert load_scenario("paper", plant={"m_p": 6.0}).description == "Based on paper"
    assert load_scenario("paper", gains={"K_a": 1.0}).description.startswith("The paper's")
    assert (softer.gains.k1, softer.gains.K_u, softer.gains.K_a, softer.gains.k0) == (90.0, 0.5, 1.0, 5.0)
    assert (softer.nominal.scale, softer.nominal.m1) == (0.8, 2.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gains.K_lambda": -2}, "gains.K_lambda: must be greater than -1, was -2"),
        ({"gains.K_I": [1, -1, 1, 1]}, "gains.K_I.2: must be at least 0, was -1"),
        ({"plant.m_p": 0}, "plant.m_p: must be greater than 0, was 0"),
        ({"plant.m_p": [1, 2, 3]}, "plant.m_p: must be one number or a list of 2, was a list of 3"),
        ({"nominal.I3": [1]}, "nominal.I3: must be one number or a list of 2, was a list of 1"),
        ({"platform.kind": ["car"]}, "platform.kind: must be one name or a list of 2, was a list of 1"),
        ({"platform.kind": ["car", "bus"]}, "platform.kind.2: must be 'differential', 'trailer' or 'car', was \"bus\""),
        ({"arm.lift": [True]}, "arm.lift: must be true, false or a list of 2, was a list of 1"),
        ({"arm.m_links": "x"}, "arm.m_links: must be a list of numbers for both robots, or one for each, was x"),
        ({"arm.m_links": []}, "arm.m_links: must be a list that is not empty, was a list of 0"),
        ({"tuning.bounds.K_I": [1.0]}, "tuning.bounds.K_I: must be a list with more entries, was [1.0]"),
        ({"plant.gravity": True}, "plant.gravity: must be a number, was True"),
        ({"plant.l2": "long"}, 'plant.l2: must be a number, was "long"'),
        ({"reference.rate": math.inf}, "reference.rate: must be finite, was inf"),
        ({"disturbance.wheel": math.nan}, "disturbance.wheel: must be finite, was nan"),
        ({"simulation.step": -0.001}, "simulation.step: must be greater than 0, was -0.001"),
        ({"simulation.seed": 1.5}, "simulation.seed: must be a whole number, was 1.5"),
        ({"simulation.record_every": 0}, "simulation.record_every: must be at least 1, was 0"),
        (
            {"simulation.step": 0.003},
            "simulation.duration: must be a whole number of step * record_every (0.003 s), was 20.0",
        ),
        ({"law.u26": "fixed"}, "law.u26: must be 'printed' or 'corrected', was \"fixed\""),
        (
            {"gains.K_sigma": [1, 2]},
            "gains.K_sigma: must be one number or a list of 6, one per independent velocity, was a list of 2",
        ),
        (
            {"coupling.rows": ["contact_normal"], "gains.K_I": [1, 1, 1, 1]},
            "gains.K_I: must be one number or a list of 1, one per constraint row, was a list of 4",
        ),
        (
            {"gains.gamma": [1, 2]},
            "gains.gamma: must be one number or a list of 5, one per estimate of (20)-(24), was a list of 2",
        ),
        ({"gains.K_lamda": 1}, "gains.K_lamda: must be a field of [gains] (did you mean K_lambda?), was unknown"),
        ({"gain": {}}, "gain: must be a section of the scenario (did you mean gains?), was unknown"),
        ({"gains": 3}, "gains: must be a table of fields, was 3"),
        ({"gains.k0.x": 3}, "gains.k0: must be a number, was {'x': 3}"),
        ({"description": 3}, "description: must be a string, was 3"),
        ({"gains": {"k0": -1, "k1": -1}}, "gains.k0: must be at least 0, was -1 (wrong too: gains.k1)"),
    ],
)
def test_bad_values_are_told_in_one_line(changes, message):
    with pytest.raises(UserError) as caught:
        Scenario().with_overrides(changes)
    assert str(caught.value) == message


def test_rows_must_be_one_of_the_four_sets():
    with pytest.raises(UserError, match=r'coupling\.rows: must be one of \["contact_normal"\], .*was \[\'guide_radial'):
        Scenario().with_overrides({"coupling.rows": ["guide_radial", "guide_height"]})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[gains]\nk0 = = 3\n", r"scenario: must be a TOML file, was .*bad\.toml \(.*line 2, column 6"),
        ("base = 3\n", r"base: must be the name or path of a scenario, was 3"),
        ('base = "bad.toml"\n', r"base: must be a scenario that does not inherit from this one, was .*bad\.toml"),
        ('base = "papr"\n', r"base: must be one of .* \(did you mean paper\?\), was papr"),
        ('base = "none.toml"\n', r"base: must be a file that can be read, was .*none\.toml \(No such file"),
        ("[gains]\nk_a = 3\n", r"gains\.k_a: must be a field of \[gains\] \(did you mean K_a\?\), was unknown"),
    ],
)
def test_bad_files_are_told_in_one_line(tmp_path, text, message):
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(UserError, match=message) as caught:
        load_scenario(tmp_path / "bad.toml")
    assert "\n" not in str(caught.value)


def test_file_in_another_encoding(tmp_path):
    (tmp_path / "bad.toml").write_bytes("description = 'Kräfte'".encode("latin-1"))
    with pytest.raises(UserError, match="must be a TOML file"):
        load_scenario(tmp_path / "bad.toml")


def test_user_error_survives_pickling():
    error = UserError("gains.k0", "at least 0", -1, more=("gains.k1", "gains.k2"))
    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == str(error) == "gains.k0: must be at least 0, was -1 (wrong too: gains.k1, gains.k2)"
    assert (copy.field, copy.must, copy.was, copy.more) == ("gains.k0", "at least 0", -1, ("gains.k1", "gains.k2"))
