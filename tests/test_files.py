"""Files and result folders are complete or not there, belong to one process, and are where the user says."""

import json
import subprocess
import sys

import numpy as np
import pytest

import coopmm_jax
from coopmm_jax.cli import main
from coopmm_jax.commands.report import report_folder
from coopmm_jax.errors import UserError
from coopmm_jax.files import (
    locked_folder,
    resolve_path,
    result_folder,
    whole_file,
    write_csv,
    write_json,
    write_npz,
    write_text,
)
from coopmm_jax.kinds.software import versions


def test_new_folder_appears_whole_with_its_parents(tmp_path):
    target = tmp_path / "a" / "b"
    with result_folder(target) as folder:
        (folder / "one.txt").write_text("1")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["one.txt"]
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert target.stat().st_mode == (tmp_path / "a").stat().st_mode


def test_existing_folder_keeps_what_is_not_replaced(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "one.txt").write_text("old")
    with result_folder(tmp_path) as folder:
        (folder / "one.txt").write_text("new")
        (folder / "figures").mkdir()
        (folder / "figures" / "two.txt").write_text("2")
        assert (tmp_path / "one.txt").read_text() == "old"
    found = {str(path.relative_to(tmp_path)): path.read_text() for path in tmp_path.rglob("*") if path.is_file()}
    assert found == {"notes.txt": "mine", "one.txt": "new", "figures/two.txt": "2"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figures", "notes.txt", "one.txt"]


@pytest.mark.parametrize("existing", [True, False])
def test_nothing_is_left_of_a_failed_run(tmp_path, existing):
    target = tmp_path / "run"
    if existing:
        target.mkdir()

    def fail_half_way():
        with result_folder(target) as folder:
            (folder / "one.txt").write_text("1")
            raise RuntimeError("blew up")

    with pytest.raises(RuntimeError, match="blew up"):
        fail_half_way()
    assert [path.name for path in tmp_path.rglob("*")] == ["run"] * existing


@pytest.mark.parametrize("name", ["file", "file/run"])
def test_target_that_cannot_be_a_folder(tmp_path, name):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(UserError, match=r"--out: must be a folder that can be written, was .*file.* \(Not a dir"),
        result_folder(tmp_path / name),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_json_is_strict(tmp_path):
    content = {"a": np.float64(0.1), "b": np.arange(2), "c": (float("nan"), np.inf), "d": {"e": None, "f": np.True_}}
    write_json(tmp_path / "x.json", content)
    text = (tmp_path / "x.json").read_text()
    assert json.loads(text) == {"a": 0.1, "b": [0, 1], "c": [None, None], "d": {"e": None, "f": True}}


def test_versions_name_what_decides_the_digits():
    assert set(versions()) == {"python", "coopmm_jax", "jax", "jaxlib", "numpy"}


def test_the_version_is_that_of_the_code_that_runs(monkeypatch):
    monkeypatch.setattr(coopmm_jax, "__version__", "9.9.9")
    assert versions()["coopmm_jax"] == "9.9.9"


def test_every_kind_of_file_holds_what_was_given(tmp_path):
    write_text(tmp_path / "a.txt", "\N{GREEK SMALL LETTER LAMDA}\n")
    write_csv(tmp_path / "a.csv", ["x", "y"], [(1, 0.1), (2, "a, b")])
    write_npz(tmp_path / "a.npz", {"x": np.arange(3), "y": np.array("text")})
    assert (tmp_path / "a.txt").read_bytes() == b"\xce\xbb\n"
    assert (tmp_path / "a.csv").read_bytes() == b'x,y\r\n1,0.1\r\n2,"a, b"\r\n'
    with np.load(tmp_path / "a.npz") as saved:
        assert saved["x"].tolist() == [0, 1, 2]
        assert str(saved["y"]) == "text"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "a.npz", "a.txt"]


def test_a_file_that_is_not_finished_leaves_the_old_one(tmp_path):
    path = tmp_path / ("n" * 250 + ".txt")  # as long as names can be
    write_text(path, "old")

    def fail_half_way():
        with whole_file(path) as stream:
            stream.write(b"new")
            stream.flush()
            assert path.read_text() == "old"
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail_half_way()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_no_planted_link_is_followed(tmp_path, monkeypatch):
    (tmp_path / "precious").write_text("mine")
    monkeypatch.setattr("secrets.token_hex", lambda count: "guessed")
    for name in (".gains.toml.partial", ".gains.toml-guessed.partial"):
        (tmp_path / name).symlink_to(tmp_path / "precious")
    with pytest.raises(FileExistsError):
        write_text(tmp_path / "gains.toml", "theirs")
    assert (tmp_path / "precious").read_text() == "mine"


def test_a_link_to_nothing_and_a_file_in_the_way(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    message = r"^--out: must be a folder that can be written, was .*link \(a link to nothing\)$"
    with pytest.raises(UserError, match=message), result_folder(tmp_path / "link"):
        pass
    (tmp_path / "one.txt").mkdir()

    def into_a_folder():
        with result_folder(tmp_path) as folder:
            write_text(folder / "one.txt", "1")

    with pytest.raises(UserError, match=r"^--out: must be a folder in which one.txt can be written, was .* \(Is a dir"):
        into_a_folder()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "one.txt"]


_HOLD = """
import sys, pathlib
from coopmm_jax.files import locked_folder
with locked_folder(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("killed", [True, False])
def test_a_folder_has_one_process_at_a_time(tmp_path, capsys, killed):
    """The second of two tunings is told so at once; after the end of the first, however it came, the folder is free."""
    folder = tmp_path / "tuned"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", _HOLD, str(folder)], text=True, **pipes) as other:
        assert other.stdout.readline() == "held\n"
        for more in ([], ["--resume"], ["--pareto", "2"]):
            assert main(["tune", "sensed", "--out", str(folder), *more]) == 2
            assert capsys.readouterr().err == (
                f"coopmm: error: --out: must be a folder that no other process is working in, was {folder}\n"
            )
        if killed:
            other.kill()
    with locked_folder(folder):
        assert folder.exists()
    assert folder.exists() == killed  # what is left of a process that was killed is not this one's to remove
    assert not folder.exists() or not list(folder.iterdir())


def test_paths_are_what_the_user_means(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("RUNS", "runs")
    assert resolve_path("~/tuned", "--out") == tmp_path / "home" / "tuned"
    assert str(resolve_path("$RUNS/${RUNS}2", "--out")) == "runs/runs2"
    assert str(resolve_path("x::y.zarr", "--out")) == "x::y.zarr"
    assert resolve_path(".", "--out") == tmp_path
    assert resolve_path("a/..", "--out") == tmp_path
    for name in ("$RUNS", "~"):  # what exists is meant
        (tmp_path / name).mkdir()
        assert str(resolve_path(name, "--out")) == name
    assert [report_folder(f"runs/{k}").name for k in ("k0_5.0", "k0_5.5", "s.zarr")] == [
        *("k0_5.0-report", "k0_5.5-report", "s-report"),
    ]


@pytest.mark.parametrize("path", ["a\0b", "~nobody-of-this-name/x", ""])
@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["simulate", "paper", "--simulation.duration", "0.01", "--out"], "--out"),
        (["simulate", "paper", "--gains-file"], "--gains-file"),
        (["simulate", "--sample", "0", "--from"], "store"),
        (["simulate"], "scenario"),
        (["animate", "paper", "--out"], "--out"),
        (["animate", "--out", "x.gif"], "SCENARIO|DIR"),
        (["sweep", "sensed", "--samples", "1", "--out"], "out"),
        (["sweep", "sensed", "--uncertainty"], "--uncertainty"),
        (["report"], "store"),
        (["tune", "sensed", "--out"], "--out"),
        (["compare", "--scenario", "sensed", "scenario"], "GAINS"),
        (["falsify", "sensed", "--out"], "--out"),
    ],
)
def test_what_can_be_no_path_is_one_line(path, words, option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*words, path]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"coopmm: error: {option}: must be ")
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())
