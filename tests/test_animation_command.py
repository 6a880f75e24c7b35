"""``coopmm animate``: what it shows, of scenarios and of folders, and what it refuses."""

import pytest

from coopmm_jax.cli import main
from coopmm_jax.runs.store import write_run

SHORT = ["--simulation.duration", "0.2", "--width", "480"]


def test_command_compares_scenarios_and_results(simulated_paper, tmp_path, capsys):
    write_run(tmp_path, simulated_paper.scenario, simulated_paper)
    out = ["--out", str(tmp_path / "film.gif")]
    assert main(["animate", "paper", "--gains.k0", "4", "--against", "paper", *SHORT, *out]) == 0
    assert capsys.readouterr().out == f"written to {tmp_path / 'film.gif'}: 6 frames\n"
    faster = ["--speed", "4", "--overwrite"]
    assert main(["animate", str(tmp_path), "--against", "paper", *SHORT, *out, *faster]) == 0
    assert capsys.readouterr().out.endswith(": 7 frames\n")


def test_command_shows_a_failed_run_and_says_so(tmp_path, capsys):
    bounds = ["--gains.beta", "126.7", "--gains.lam-min", "0.63"]
    assert main(["animate", "paper", *bounds, *SHORT, "--out", str(tmp_path / "film.gif")]) == 3
    assert "rollout paper, gains.beta 126.7, gains.lam_min 0.63 failed: SPEED at t =" in capsys.readouterr().err
    assert (tmp_path / "film.gif").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["paper"], "the following arguments are required: --out"),
        (["papr", "--out", "x.gif"], "scenario: must be one of "),
        (["paper", "--out", "x.gif", "--against", "papr"], "scenario: must be one of "),
        (["paper", "--out", "x.avi"], "--out: must be a file that ends in .gif, .html, .mp4, was x.avi"),
        (
            ["empty", "--gains-file", "tuned", "--out", "x.gif"],
            "--gains-file: must be given with a scenario to simulate, was given with empty",
        ),
        (["paper", "--out", "x.gif", "--width", "398"], "width: must be an even number of pixels"),
        (["empty", "--out", "x.gif"], "run: must be a folder that coopmm simulate --out has written, was empty ("),
        (
            ["empty", "--gains.k0", "2", "--out", "x.gif"],
            "--gains.k0: must be given with a scenario to simulate, was given with empty",
        ),
        (
            ["empty", "--simulation.seed", "2", "--gains.k0", "2", "--out", "x.gif", "--against", "paper"],
            "--gains.k0: must be given with a scenario to simulate, was given with empty",
        ),
    ],
)
def test_command_refuses_in_one_line(arguments, message, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    assert main(["animate", *arguments]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"coopmm: error: {message}")
    assert said.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]
