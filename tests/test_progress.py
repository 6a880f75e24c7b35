"""Lines that a search says while it runs, and the time left, from paces that change on the way."""

import io

import pytest

from coopmm_jax.scenario.sections.tuning import TuningSection
from tuning.commands.progress import FINER, Progress, TimeLeft
from tuning.studies.result import Row

BUDGET = 180e6


def row(iteration, stage, steps):
    return Row(iteration, stage, 1.0, 1.0, 0, steps, 0.0)


def course(first, second, each=2e6):
    """Rows of a search of the default budget, and when they come: so many seconds a step in either half [s]."""
    steps, now, rows = 20e6, 7.0, [(row(0, "screening", 20e6), 7.0)]
    while steps < BUDGET:
        fine = steps >= BUDGET / 2
        stage = ("scanning" if steps < 120e6 else "searching") if fine else "scanning" if steps < 40e6 else "searching"
        steps, now = steps + each, now + each * (second if fine else first)
        rows.append((row(len(rows), stage, steps), now))
    return rows


@pytest.mark.parametrize(("optimiser", "finer"), [("auto", FINER), ("lbfgs", 1.0)])
def test_the_second_half_is_known_to_be_slower(optimiser, finer):
    rows = course(first=1e-7, second=finer * 1e-7)
    left, end = TimeLeft(TuningSection(optimiser=optimiser)), rows[-1][1]
    assert left.after(*rows[0]) is None
    for each, now in rows[1:]:
        assert left.after(each, now) == pytest.approx(end - now, abs=1e-6)


def test_a_second_half_of_another_pace_is_found_out_by_its_first_step():
    rows = course(first=1e-7, second=5e-7)
    left, end = TimeLeft(TuningSection()), rows[-1][1]
    second = next(i for i, (each, _) in enumerate(rows) if each.steps > BUDGET / 2)
    found = [left.after(each, now) for each, now in rows]
    assert found[second - 1] == pytest.approx(FINER / 5.0 * (end - rows[second - 1][1]), rel=1e-6)
    assert found[second:] == pytest.approx([end - now for _, now in rows[second:]], abs=1e-6)


def test_a_search_that_is_resumed_in_its_second_half_goes_by_its_own_pace():
    left = TimeLeft(TuningSection())
    assert left.after(row(90, "searching", 100e6), 3.0) is None
    assert left.after(row(91, "searching", 110e6), 4.0) == pytest.approx(7.0)


def test_what_is_minimised_is_named_and_explained_once():
    said = io.StringIO()
    shown = Progress(TuningSection(goals="requirements"), said)
    for each in (row(0, "screening", 1e6), row(1, "scanning", 2e6)):
        shown.row(each)
    lines = said.getvalue().splitlines()
    assert lines[0].startswith("goals' value: the largest soft requirement, 1 at its limit")
    assert [line.split(",")[0] for line in lines[1:]] == ["screening 0: goals' value 1", "scanning 1: goals' value 1"]


def test_every_weighting_of_a_front_begins_anew():
    left = TimeLeft(TuningSection(precision="float64"))
    for began in (0.0, 100.0):
        assert left.after(row(0, "starting", 0.6e6), began) is None
        assert left.after(row(1, "scanning", 10.6e6), began + 1.0) == pytest.approx(16.94)


def test_lines_say_how_far_a_search_is():
    stream = io.StringIO()
    shown = Progress(TuningSection(), stream)
    shown.stage("screening")
    shown.row(row(0, "screening", 20e6))
    shown.row(row(1, "scanning", 21e6))
    first, second, third = stream.getvalue().splitlines()
    assert first == "screening"
    assert second == "screening 0: cost 1, best 1, 20 of 180 M steps"
    assert third.startswith("scanning 1: cost 1, best 1, 21 of 180 M steps, ")
    assert third.endswith(" s left")
