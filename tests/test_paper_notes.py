"""The paper notes: the figures that need no simulation, and that every check and test they name exists."""

import re
from math import cos, dist, hypot, sin
from pathlib import Path

import pytest

from coopmm_jax.parameters import PAPER_START
from experiments import paper_checks

NOTES = Path(paper_checks.__file__).with_name("paper_notes.md").read_text(encoding="utf-8")


def values(check):
    return list(paper_checks.CHECKS[check]().values())


def test_reference_as_printed_slips_and_is_out_of_reach():
    slip, usual_axes, distance, reach, start_slip = values("reference")
    assert slip == pytest.approx([0.8, 0.0], abs=1e-9)
    assert usual_axes[1] == pytest.approx(2.4)
    assert distance == pytest.approx([2.3, 0.7])
    assert distance[0] > reach > distance[1]
    assert start_slip == 0.5


def constraint_rows(poses):
    """phi of the four rows, from the tips' positions, for robots at th = 0 on the x axis."""
    reaches, heights = zip(
        *((0.5 * (cos(p.a2) + cos(p.a2 + p.a3)), 0.5 * (sin(p.a2) + sin(p.a2 + p.a3))) for p in poses), strict=True
    )
    tips = [(p.x - reach * sin(p.a1), reach * cos(p.a1)) for p, reach in zip(poses, reaches, strict=True)]
    centre = (tips[1][0] + 0.7 * sin(poses[1].a1), tips[1][1] - 0.7 * cos(poses[1].a1))
    normal = (0.7**2 - dist(tips[0], centre) ** 2) / 1.4
    return [normal, heights[0] - heights[1], (hypot(*tips[1]) ** 2 - 1.7**2) / 3.4, heights[1]]


def test_start_as_printed_misses_the_contact():
    printed, angles, residual, forces = values("start")
    assert [float(phi) for phi in printed] == pytest.approx(constraint_rows(PAPER_START), rel=1e-12)
    assert [float(a) for a in angles] == pytest.approx([-0.731919, 1.463837, 2.094395, 2.094395], abs=5e-7)
    assert float(residual) < 1e-15
    assert [float(x) for x in forces] == pytest.approx([8.01362, 4.75186, -3.76017, 12.27700], abs=5e-6)


def test_coriolis_matrix_as_printed_makes_power():
    printed, corrected = values("coriolis")
    assert printed == pytest.approx(-6.0, rel=1e-14)
    assert corrected == pytest.approx(0.0, abs=1e-14)


def test_backstepping_holds_in_one_reading():
    right_26, wrong_26, right_27, *wrong_27 = values("backstepping")
    assert right_26 == pytest.approx(0.0, abs=1e-15)
    assert right_27 == pytest.approx(0.0, abs=1e-15)
    assert [wrong_26, *wrong_27] == pytest.approx([-0.3, 0.225, 0.1125, 0.375], rel=1e-13)


def test_longer_chains_need_a_higher_power():
    right, printed = values("longer_chain")
    assert right == pytest.approx([0.0, 0.0], abs=1e-13)
    assert printed == pytest.approx([-0.590625, -12.660705], abs=1e-6)


def test_34_holds_in_one_reading():
    assert values("robust_term") == pytest.approx([-1 / 21, 9 / 11], rel=1e-13)


def test_39_has_a_counterexample():
    right, counterexample, (printed, corrected) = values("u26")
    assert counterexample == pytest.approx(0.5, rel=1e-14)
    assert printed == pytest.approx(0.5, rel=1e-8)
    assert corrected < right == 0.01


def test_notes_name_every_check_and_nothing_else():
    named = set(re.findall(r"`([a-z]\w*)`", NOTES)) - {"code", "paper"}
    assert named == set(paper_checks.CHECKS)


def test_notes_name_tests_that_exist():
    named = set(re.findall(r"`(\w+\.py)::(\w+)`", NOTES))
    assert len(named) > 10
    for file, test in named:
        assert f"def {test}(" in (Path(__file__).with_name(file)).read_text(encoding="utf-8"), f"{file}::{test}"


def test_unknown_check_is_named(capsys):
    assert paper_checks.main(["nothing"]) == 2
    assert capsys.readouterr().err.startswith("paper_checks: check: must be one of reference, ")
