"""The reproduction of section IV on a short horizon: its files, its summary, its exit codes."""

import dataclasses
import json

import pytest
from PIL import Image

import coopmm_jax as cm
from coopmm_jax import plotting
from coopmm_jax.metrics.table import SHOWN
from coopmm_jax.proof.lyapunov import analyse
from coopmm_jax.status import Status
from experiments import reproduce_paper
from tests.pictures import rendering

PICTURES = [f"fig{number:02}.png" for number in range(3, 11)]
FILES = sorted([*PICTURES, "full.toml", "projected.toml", "summary.json"])


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results") / "paper"
    with rendering():
        assert reproduce_paper.main(["--duration", "0.05", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def runs(results):
    return {reading: cm.simulate(results / f"{reading}.toml") for reading in reproduce_paper.READINGS}


@pytest.fixture
def simulated(monkeypatch, runs):
    """Let the study have these runs at once."""
    monkeypatch.setattr(reproduce_paper, "_simulate", lambda duration: runs)
    return runs


def refused(capsys, *argv):
    """The one line that a refusal prints."""
    with pytest.raises(SystemExit) as ended:
        reproduce_paper.main(argv)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_writes_every_file_and_nothing_else(results):
    assert sorted(path.name for path in results.iterdir()) == FILES
    assert [path.name for path in results.parent.iterdir()] == ["paper"]
    for name in PICTURES:
        with Image.open(results / name) as picture:
            assert picture.format == "PNG"
            assert picture.getextrema()[0] == (0, 255), "nothing drawn"


def test_summary_says_what_was_run_and_found(results, runs):
    summary = json.loads((results / "summary.json").read_text())
    assert list(summary["runs"]) == ["projected", "full"]
    for reading, run in runs.items():
        entry = summary["runs"][reading]
        assert entry["status"] == "OK"
        assert entry["metrics"] == pytest.approx(run.metrics, rel=1e-12)
        assert entry["scenario"]["law"]["feedforward"] == reading
        assert {"python", "coopmm_jax", "jax"} <= set(entry["versions"])
    assert summary["largest_constraint_residual"] == max(
        run.metrics["constraint_residual_max"] for run in runs.values()
    )
    eigenvalues = analyse(runs["projected"], every=reproduce_paper.ANALYSED).eigenvalues
    assert summary["reduced_inertia_eigenvalues"] == pytest.approx([eigenvalues.min(), eigenvalues.max()], rel=1e-12)
    assert set(summary["lyapunov"]["bound_40"]) == {"excess", "t", "share"}
    assert list(summary["figures"]) == PICTURES


def test_table_shows_both_readings(runs):
    lines = reproduce_paper.table(runs, analyse(runs["projected"], every=10)).splitlines()
    assert lines[0].split() == ["feed-forward", "projected", "full"]
    assert [line.split()[0] for line in lines[1 : len(SHOWN) + 1]] == list(SHOWN)
    (force,) = (line.split() for line in lines if line.startswith("force_min "))
    assert [float(value) for value in force[1:3]] == pytest.approx(
        [run.metrics["force_min"] for run in runs.values()], rel=1e-3
    )
    assert lines[-2].startswith("eigenvalues of the reduced inertia: ")


def test_second_run_replaces_the_first(results, simulated, capsys):
    (results / "summary.json").write_text("of an earlier run")
    assert reproduce_paper.main(["--out", str(results)]) == 0
    assert json.loads((results / "summary.json").read_text())["runs"]
    assert str(results) in capsys.readouterr().out


def test_failed_rollout_is_reported_and_shown(simulated, monkeypatch, tmp_path, capsys):
    failed = dataclasses.replace(simulated["full"], status=Status.SPEED, status_time=0.05)
    monkeypatch.setitem(simulated, "full", failed)
    assert reproduce_paper.main(["--out", str(tmp_path / "paper")]) == 3
    assert capsys.readouterr().err == (
        f"reproduce_paper: rollout full failed: SPEED at t = 0.05 s: {Status.SPEED.message}\n"
    )
    assert sorted(path.name for path in (tmp_path / "paper").iterdir()) == FILES


def test_a_disk_that_fills_up_leaves_nothing(simulated, monkeypatch, tmp_path, capsys):
    save = plotting.save

    def full_at_the_fifth(figure, path):
        if path.name == "fig05.png":
            raise OSError(28, "No space left on device")
        save(figure, path)

    monkeypatch.setattr(plotting, "save", full_at_the_fifth)
    assert "No space left on device" in refused(capsys, "--out", str(tmp_path / "paper"))
    assert list(tmp_path.iterdir()) == []


def test_folder_that_cannot_be_written_is_found_before_the_simulation(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(reproduce_paper, "_simulate", None)  # calling it would be an error of another kind
    (tmp_path / "file").write_text("in the way")
    line = refused(capsys, "--out", str(tmp_path / "file" / "paper"))
    assert line.startswith("reproduce_paper: error: --out: must be a folder that can be written, was ")
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.parametrize(
    ("argv", "line"),
    [
        (["--duration", "-1"], "simulation.duration: must be greater than 0, was -1.0"),
        (["--duration", "long"], "argument --duration: invalid float value: 'long'"),
        (["--outt", "x"], "unrecognized arguments: --outt x"),
    ],
)
def test_options_that_cannot_be_used(argv, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert refused(capsys, *argv) == f"reproduce_paper: error: {line}"
    assert list(tmp_path.iterdir()) == []
