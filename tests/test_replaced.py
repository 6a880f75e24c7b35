"""Fields that others stand in the place of: dropped of a base, refused beside them, and never varied in vain."""

import tomllib

import pytest

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import load_scenario

HALF = {"distribution": "uniform", "low": 0.5, "high": 1.0}
PITCH = {"initial.pitch": [0.6, -1.7, 1.6]}


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("long_arm", {"plant.m2": 0.7}, "plant.m2: must be left out where arm.l_links is given, was 0.7"),
        ("long_arm", {"nominal.I3": 0.7}, "nominal.I3: must be left out where arm.l_links is given, was 0.7"),
        (
            "long_arm",
            {"initial.a2": [0.1, 2.62]},
            "initial.a2: must be left out where arm.l_links and initial.pitch are given, was (0.1, 2.62)",
        ),
        (
            "ellipse",
            {"reference.radius": 2.0},
            "reference.radius: must be left out where reference.path is given, was 2.0",
        ),
        (
            "ellipse",
            {"reference.contact_force": 2.0},
            "reference.contact_force: must be left out where reference.force is given, was 2.0",
        ),
        (
            "ellipse",
            {"coupling.guide_radius": 2.0},
            "coupling.guide_radius: must be left out where reference.path is given, was 2.0",
        ),
        ("sensed", {"nominal.m_f": 4.0}, "nominal.m_f: must be left out of differential drives, was 4.0"),
        ("sensed", {"tuning.gains": ["k4"]}, "tuning.gains: must be without k4, which differential drives do without"),
        (
            "long_arm",
            {"uncertainty": {"plant.l2": HALF}},
            "uncertainty.plant.l2: must be left out where arm.l_links is given, was given",
        ),
        (
            "sensed",
            {"uncertainty": {"nominal.m_f": HALF}},
            "uncertainty.nominal.m_f: must be left out of differential drives, was given",
        ),
    ],
)
def test_what_nothing_reads_is_refused(name, changes, message):
    with pytest.raises(UserError) as caught:
        load_scenario(name, **changes)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("base", ["", 'base = "long_arm"\n'])
def test_a_file_that_gives_what_nothing_reads_is_refused(tmp_path, base):
    links = "[arm]\nl_links = [0.2, 0.2, 0.15]\nm_links = [0.5, 0.4, 0.3]\nI_links = [0.4, 0.3, 0.2]\n"
    started = "[initial]\npitch = [[0.6, -1.7, 1.6], [2.5, 1.7, -1.6]]\n"
    file = tmp_path / "mine.toml"
    file.write_text(base + links + started, encoding="utf-8")
    load_scenario(file)
    for beside, place in (("[plant]\nm2 = 0.7\n", "plant.m2"), ("a2 = 0.1\n", "initial.a2")):
        file.write_text(base + links + started + beside, encoding="utf-8")
        with pytest.raises(UserError, match=f"^{place}: must be left out where arm.l_links"):
            load_scenario(file)


def test_what_replaces_fields_drops_those_of_the_base(tmp_path):
    of_base = {"reference.radius": [2.3, 0.9], "coupling.guide_radius": 1.6, "plant.m2": 0.7, "initial.a2": [-0.9, 2.6]}
    base = load_scenario("paper", **of_base)
    (tmp_path / "base.toml").write_text(base.to_toml(), encoding="utf-8")
    arm = {"arm.l_links": [0.2, 0.2, 0.15], "arm.m_links": [0.5, 0.4, 0.3], "arm.I_links": [0.4, 0.3, 0.2]}
    changes = arm | PITCH | {"reference.path.kind": "circle"}
    for changed in (load_scenario(tmp_path / "base.toml", **changes), base.with_overrides(changes)):
        assert (changed.reference.radius, changed.coupling.guide_radius) == ((2.4, 1.0), 1.7)
        assert (changed.plant.m2, changed.initial.a2) == (0.5, (-0.9273, 2.62))
        assert changed.with_overrides(tomllib.loads(changed.to_toml())) == changed


def test_what_only_one_robot_replaces_stays():
    lifted = {"arm.lift": [True, False], "initial.pitch": [[0.1, 1.0], [2.0, 1.0]], "initial.a2": [-0.5, 2.5]}
    assert load_scenario("paper", **lifted).parameters().start[1].a2 == 2.5


@pytest.mark.parametrize("name", ["trailer", "mixed"])
def test_gains_and_masses_of_two_axles_are_read_there(name):
    changed = load_scenario(name, nominal={"m_f": 4.0}, tuning={"gains": ["k4"]})
    assert changed.parameters().nominal[1].front.m_f == 4.0
