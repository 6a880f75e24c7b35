"""The wheel, installed where no checkout can be imported: its files, and the command ``coopmm`` that it brings."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
from pathlib import Path
from zipfile import ZipFile

import jax
import pytest

import coopmm_jax

ROOT = Path(__file__).parent.parent
LEFTOVERS = shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "results", "*.egg-info")

PIP = ("--quiet", "--no-index", "--no-deps", "--no-compile")


def run(*words, cwd=None):
    """Output of a program in an environment that does not point to the checkout."""
    own = {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir}
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(word) for word in words], cwd=cwd, env=inherited | own, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("wheel")


@pytest.fixture(scope="module")
def built(folder):
    """Wheel and source distribution, made of a copy, as a build folder left in the tree would add modules of old."""
    shutil.copytree(ROOT, folder / "source", ignore=LEFTOVERS)
    code = f"from setuptools.build_meta import *; build_sdist({str(folder)!r}); build_wheel({str(folder)!r})"
    run(sys.executable, "-c", code, cwd=folder / "source")
    (wheel,), (source,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, source


@pytest.fixture(scope="module")
def wheel(built):
    return built[0]


@pytest.fixture(scope="module")
def programs(folder, wheel):
    """The programs of a new environment with the wheel, which borrows its dependencies from this one."""
    environment = folder / "environment"
    venv.create(environment, symlinks=True)
    python = environment / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", *PIP, wheel)
    (packages,) = environment.glob("lib/python*/site-packages")
    # The folders are searched for modules, but the .pth files in them, the checkout's for one, are not read.
    borrowed = dict.fromkeys(sysconfig.get_path(name) for name in ("purelib", "platlib"))
    (packages / "borrowed.pth").write_text("\n".join(borrowed), encoding="utf-8")
    return environment / "bin"


def test_wheel_holds_both_packages_with_their_data_and_nothing_else(folder, wheel):
    source = folder / "source"
    files = [path for package in ("coopmm_jax", "tuning") for path in (source / package).rglob("*") if path.is_file()]
    with ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert names == {path.relative_to(source).as_posix() for path in files}
    kinds = {"coopmm_jax/py.typed", "tuning/py.typed", "coopmm_jax/scenarios/paper.toml"}
    assert names > kinds | {"coopmm_jax/animation/player.html"}


def test_source_distribution_holds_the_whole_tree(folder, built):
    """All of it, so that ``make test`` and ``make docs`` work there as in a checkout."""
    source = folder / "source"
    whole = {path.relative_to(source).as_posix() for path in source.rglob("*") if path.is_file()}
    tree = {name for name in whole if not name.startswith(("build/", "coopmm_jax.egg-info/"))}  # left by the wheel
    with tarfile.open(built[1]) as archive:
        names = {member.name.partition("/")[2] for member in archive if member.isfile()}
    made = {"PKG-INFO", "setup.cfg"}
    assert {name for name in names - made if not name.startswith("coopmm_jax.egg-info/")} == tree


def test_what_a_package_index_shows(folder, wheel):
    with ZipFile(wheel) as archive:
        (about,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith("/METADATA"))
    fields = [line.partition(": ")[::2] for line in about.partition("\n\n")[0].splitlines()]
    assert {value for name, value in fields if name == "Provides-Extra"} == {
        "bench",
        "cluster",
        "docs",
        "notebooks",
        "test",
    }
    assert ("License-Expression", "MIT") in fields
    assert ("Classifier", "Typing :: Typed") in fields
    assert wheel.stat().st_size < 1_000_000


def test_modules_come_from_the_wheel(folder, programs):
    code = "import coopmm_jax, tuning; print(coopmm_jax.__file__, tuning.__file__, coopmm_jax.__version__, sep='\\n')"
    *files, version = run(programs / "python", "-c", code, cwd=folder).splitlines()
    assert all(Path(file).is_relative_to(folder / "environment") for file in files), files
    assert version == coopmm_jax.__version__


def test_command_runs_away_from_the_checkout_and_needs_no_display(folder, programs):
    code = "import sys; from coopmm_jax.cli import main; main(); print('matplotlib.pyplot' in sys.modules)"
    words = ("simulate", "paper", "--simulation.duration", "0.02", "--out", "run")
    out = run(programs / "python", "-c", code, *words, cwd=folder)
    assert "contact" in out  # among the metrics
    assert out.endswith("False\n")
    assert (folder / "run" / "overview.png").stat().st_size > 10_000
    assert "--adversarial" in run(programs / "coopmm", "tune", "--help", cwd=folder)
