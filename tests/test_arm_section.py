"""The section of the arms: lists of links, what fits them and what varies of them."""

import random
import re
import textwrap
import tomllib
from pathlib import Path

import numpy as np
import pytest

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import Arm, LiftedArm, LinkInertia
from coopmm_jax.scenario.feasible import check_reference
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.scenario.variation import vary

LINKS = {"l_links": [0.2, 0.2, 0.15], "m_links": [0.5, 0.4, 0.3], "I_links": [0.4, 0.3, 0.2]}
BOTH = {name: [numbers, numbers[:2]] for name, numbers in LINKS.items()}
PITCH = {"pitch": [[0.6, -1.7, 1.6], [2.5, 1.7]]}
ONE = {name: [0.3] for name in LINKS}


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"arm": ONE}, "arm.l_links: must be 2 links of robot I or more, a lift counting as one, for the rows of"),
        ({"arm": LINKS}, "initial.pitch: must be given, one number per link, where an arm has more than two"),
        (
            {"arm": LINKS, "initial": {"pitch": [1.0, 2.0]}},
            "initial.pitch: must be a list of 3, one per pitch link of robot I, was a list of 2",
        ),
        (
            {"arm": {"l_links": [0.3, 0.3]}},
            "arm.m_links: must be given, where another list of the links is, was missing",
        ),
        (
            {"arm": LINKS | {"m_links": [1.0]}},
            "arm.m_links: must be a list of 3, one per pitch link of robot I, was a list of 1",
        ),
        ({"arm": {name: [0.3] * 7 for name in LINKS}}, "arm.l_links: must be a list of at most 6, one per pitch link"),
        ({"arm": {"l_links": [[0.3], 0.2]}}, "arm.l_links: must be a list of numbers for both robots, or one for each"),
        ({"arm": LINKS | {"l_links": [0.3, 0.3, 0.0]}}, "arm.l_links.3: must be greater than 0, was 0"),
        ({"nominal": {"m_links": [1.0]}}, "nominal.m_links: must be left out without links or a lift in [arm]"),
        ({"initial": {"lift": 0.1}}, "initial.lift: must be left out of arms without a lift, was 0.1"),
        ({"arm": LINKS, "initial": PITCH}, "initial.pitch: must be a list of 3, one per pitch link of robot II, was"),
    ],
)
def test_what_does_not_fit_is_one_line(changes, complaint):
    with pytest.raises(UserError) as caught:
        load_scenario("paper", **changes)
    assert str(caught.value).startswith(complaint)
    assert "\n" not in str(caught.value)


def test_lists_of_links_load_are_saved_and_set_the_joints():
    scenario = load_scenario("paper", arm=BOTH, initial=PITCH)
    assert scenario.structure().joints == (6, 5)
    assert scenario.with_overrides(tomllib.loads(scenario.to_toml())) == scenario
    loaded = scenario.parameters()
    assert loaded.plant.geometry[1].arm == Arm((0.2, 0.2))
    assert loaded.plant.inertia[0].links == LinkInertia((0.5, 0.4, 0.3), (0.4, 0.3, 0.2))
    assert loaded.start[0].joints == (0.6, -1.7, 1.6)
    assert len(loaded.gains.K_sigma) == 11 - 4
    lifted = load_scenario("paper", arm={"lift": [True, False]}, initial={"lift": 0.1}, nominal={"m2": 0.3})
    assert lifted.parameters().plant.geometry[0].arm == LiftedArm((0.25, 0.25))
    assert lifted.parameters().plant.geometry[1].arm is None
    assert lifted.parameters().start[0].joints == (0.1, -0.9273, 1.8546)
    assert lifted.parameters().nominal[0].links == LinkInertia((0.3, 0.5), (0.5, 0.5))


def test_each_number_of_a_list_varies_and_the_controller_keeps_its_own():
    spread = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
    entries = {"arm.m_links.1.3": spread, "arm.l_links.2": spread, "arm.I_links": spread | {"each": True}}
    variation = vary(load_scenario("paper", arm=BOTH, initial=PITCH, uncertainty=entries))
    names = ["arm.m_links.1.3", "arm.l_links.2.1", "arm.l_links.2.2"]
    names += [f"arm.I_links.{robot}.{link}" for robot, links in ((1, 3), (2, 2)) for link in range(1, links + 1)]
    assert [number.name for number in variation.numbers] == names
    assert len(variation.draws) == 2 + 5
    drawn = variation.batch(np.full((1, 7), 0.75), [0])
    assert drawn.plant.inertia[0].links.m_links[2] == pytest.approx([0.33])
    assert drawn.plant.geometry[1].arm.l_links[0] == pytest.approx([0.22])
    assert drawn.nominal[0].links.m_links[2] == pytest.approx([0.3])
    alone = variation.sample(0, {number.name: 1.1 * number.base for number in variation.numbers}).parameters()
    assert alone.plant.inertia[1].links.I_links == pytest.approx((0.44, 0.33))
    assert alone.nominal[1].links == LinkInertia((0.5, 0.4), (0.4, 0.3))
    masses = vary(load_scenario("sensed", arm=LINKS, initial={"pitch": [0.6, -1.7, 1.6]})).numbers
    assert {number.place for number in masses} >= {"arm.m_links", "arm.I_links", "plant.m_p"}
    assert "plant.m2" not in {number.place for number in masses}
    for name, must in (
        ("arm.m_links.1.9", r"arm\.m_links\.1\.1 to \.1\.3 or arm\.m_links\.2\.1 to \.2\.2"),
        ("arm.m_links.x", r"arm\.m_links, or one of its numbers as arm\.m_links\.1"),
    ):
        with pytest.raises(UserError, match=rf"uncertainty\..*: must be {must}, was"):
            load_scenario("paper", arm=BOTH, initial=PITCH, uncertainty={name: spread})


def test_links_that_stay_where_they_start_are_told_by_their_own_name():
    with pytest.raises(UserError, match=r"^initial\.pitch: must be such that the last two links of arm II bridge"):
        check_reference(load_scenario("long_arm", initial={"pitch": [[0.6, -1.7, 1.6], [0.2, 1.7, -1.6]]}))


ODD = (0, 1, -1.5, 0.5, 1e300, float("nan"), "none", True, [], [0.5], [0.5, 0.7], [[0.5, 0.5], [0.3]], [0.3] * 3, {})


def odd_arms(count, seed=0):
    """Complaints about odd sections of arms and platforms, as many as ``count``."""
    draw, refused = random.Random(seed), []
    fields = ("lift", "l_links", "m_links", "I_links", "colour")
    for _ in range(count):
        links = draw.randrange(1, 4)
        table = {name: [draw.choice((0.2, 0.3))] * links for name in fields[1:4]} if draw.random() < 0.7 else {}
        table |= {draw.choice(fields): draw.choice(ODD) for _ in range(draw.randrange(3))}
        start = {draw.choice(("pitch", "lift", "a2")): draw.choice(ODD) for _ in range(draw.randrange(3))}
        platform = {"kind": draw.choice(("differential", "car", "trailer", ["car", "differential"]))}
        other = {"m_links": draw.choice(ODD)} if draw.random() < 0.2 else {}
        rows = {"rows": ["contact_normal"]} if draw.random() < 0.3 else {}
        try:
            scenario = load_scenario(
                "paper_full", arm=table, initial=start, platform=platform, nominal=other, coupling=rows
            )
            check_reference(scenario)
            scenario.to_toml()
        except UserError as error:
            refused.append(str(error))
    return refused


def test_odd_sections_are_refused_in_one_line_or_pass():
    refused = odd_arms(150)
    assert 40 < len(refused) < 145
    assert not any("\n" in line for line in refused)


def test_the_pages_example_is_a_scenario(tmp_path):
    page = (Path(__file__).parent.parent / "docs" / "arms.md").read_text(encoding="utf-8")
    example = re.match(r"# .*\n\n((?: {4}.*\n|\n)*)", page)[1]
    (tmp_path / "arm.toml").write_text('base = "sensed"\n' + textwrap.dedent(example))
    assert load_scenario(tmp_path / "arm.toml").structure().joints == (6, 5)
