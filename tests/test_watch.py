"""``coopmm watch``: a tuning from its files, while it runs and after its end."""

import numpy as np
import pytest

from coopmm_jax.cli import main
from coopmm_jax.commands import watch
from coopmm_jax.files import locked_folder
from tests.closed_costs import replace_rollouts, scenario
from tuning import tune
from tuning.studies import state


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """Folder of a tuning around closed-form costs, with its result."""
    folder = tmp_path_factory.mktemp("tuned")
    with pytest.MonkeyPatch.context() as patch:
        replace_rollouts(patch)
        return folder, tune(scenario(budget=8.0), out=folder)


def test_it_tells_what_the_tuning_has_come_to(tuned, capsys):
    folder, result = tuned
    assert (watch.HISTORY, watch.STATE, watch.SETTINGS) == (state.HISTORY, state.NAME, state.SETTINGS)
    assert main(["watch", str(folder)]) == 0
    lines = capsys.readouterr().out.splitlines()
    last = result.history[-1]
    assert lines[0].startswith(f"{folder}: ended after {last.stage} {last.iteration}; ")
    assert f" of {result.scenario.tuning.budget:.3g} M steps" in lines[0]
    assert f"lowest cost so far {last.best:.4g}" in lines
    shown = dict(line.split() for line in lines[-len(result.labels) :])
    assert list(shown) == result.labels
    assert all(float(value) > -1.0 for value in shown.values())


def test_a_running_one_is_shown_again_when_it_has_changed(tuned, tmp_path, monkeypatch, capsys):
    folder, _ = tuned
    rows = (folder / watch.HISTORY).read_text().splitlines(keepends=True)
    (tmp_path / watch.SETTINGS).write_bytes((folder / watch.SETTINGS).read_bytes())
    (tmp_path / watch.HISTORY).write_text("".join(rows[:2]) + "2,half a li")

    later = iter(("", "".join(rows), None))

    def passes(seconds):
        text = next(later)
        if text:
            (tmp_path / watch.HISTORY).write_text(text)
        if text is None:
            (tmp_path / "gains.toml").write_text("")

    monkeypatch.setattr(watch.time, "sleep", passes)
    assert main(["watch", str(tmp_path), "--every", "0.5"]) == 0
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith(str(tmp_path))]
    assert [line.split(": ")[1].split(" ")[0] for line in said] == ["in", "in", "ended"]
    assert said[0].startswith(f"{tmp_path}: in screening 0; ")


def test_one_that_has_only_begun_is_waited_for(tmp_path):
    with locked_folder(tmp_path):
        lines, ended = watch.view(tmp_path)
    assert not ended
    assert lines == [f"{tmp_path}: compiling and screening; the first cost comes when all starts are measured"]


def test_controllers_in_folders_of_their_own_are_shown_together(tuned, tmp_path):
    for name in ("pid", "paper"):
        (tmp_path / name).mkdir()
        for file in (watch.HISTORY, watch.SETTINGS):
            (tmp_path / name / file).write_bytes((tuned[0] / file).read_bytes())
    (tmp_path / "pid" / "gains.toml").write_text("")
    lines, ended = watch.view(tmp_path)
    assert not ended
    assert [line.split(": ")[1].split()[0] for line in lines if str(tmp_path) in line] == ["in", "ended"]
    (tmp_path / "paper" / "gains.toml").write_text("")
    with locked_folder(tmp_path):  # a third one is still to come
        assert not watch.view(tmp_path).ended
    assert watch.view(tmp_path).ended


def test_the_report_of_a_front_ends_it(tmp_path):
    (tmp_path / "report.html").write_text("")
    with locked_folder(tmp_path):
        assert not watch.view(tmp_path).ended
    assert watch.view(tmp_path) == ([f"{tmp_path}: ended, see report.html"], True)


def test_the_curve_falls_as_the_costs_do():
    steps = np.linspace(0.0, 1e6, 30)
    lines = watch.curve(steps.tolist(), (10.0 ** -np.linspace(0.0, 2.0, 30)).tolist())
    columns = [[i for i, c in enumerate(line[11:]) if c == "*"] for line in lines]
    assert [min(columns[k]) < min(columns[k + 1]) for k in range(len(columns) - 1)] == [True] * (len(columns) - 1)
    assert lines[0].startswith("         1 *")
    assert lines[-1].startswith("      0.01 ")
    assert all("*" not in line for line in watch.curve([1.0], [2.0])[1:])


def test_what_cannot_be_watched_is_refused(tmp_path, capsys):
    (tmp_path / "bad").mkdir()
    for text, said in (
        ("", "a folder with a history.csv of positive costs"),
        ("iteration,stage\n0,screening\n", "a folder with a history.csv that can be read"),
        ("steps,best,seconds\n1,x,1\n", "a folder with a history.csv that can be read"),
    ):
        (tmp_path / "bad" / watch.HISTORY).write_text(text)
        assert main(["watch", str(tmp_path / "bad")]) == 2
        assert capsys.readouterr().err.startswith(f"coopmm: error: DIR: must be {said}")
    assert main(["watch", str(tmp_path / "nothing")]) == 2
    assert "DIR: must be the folder of a tuning, or the store of a sweep" in capsys.readouterr().err
    assert main(["watch", str(tmp_path), "--every", "0"]) == 2
    assert capsys.readouterr().err == "coopmm: error: --every: must be a time above 0 s, was 0.0\n"
