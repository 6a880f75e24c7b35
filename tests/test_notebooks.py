"""The notebooks run from a clean checkout, at small size, and are committed without what running them leaves behind."""

import os
import re
from pathlib import Path

import jax
import nbformat
import pytest
from nbclient import NotebookClient

from coopmm_jax import list_scenarios

EXPERIMENTS = Path(__file__).parents[1] / "experiments"
NOTEBOOKS = sorted((EXPERIMENTS / "notebooks").glob("*.ipynb"))
each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
BEGIN = """
import atexit, gc
from tests import pictures

pictures.leave_pictures_blank(streams=True)
atexit.register(gc.freeze)  # leaves nothing to the collections at the end, which take a second each
"""
SECONDS = 300  # of one cell, with every function compiled anew on a busy machine


@pytest.fixture(scope="module")
def kernel():
    """Client of the kernel that all notebooks share: its imports and compiled programs, not names.

    Of small size, with the compilation cache of the tests and their options of XLA, and with blank pictures.
    """
    environment = os.environ | {"COOPMM_SMALL": "1", "COOPMM_CACHE_DIR": jax.config.jax_compilation_cache_dir}
    environment["PYTHONPATH"] = str(EXPERIMENTS.parent)
    place = {"metadata": {"path": EXPERIMENTS / "notebooks"}}
    begin = nbformat.v4.new_code_cell(BEGIN)
    client = NotebookClient(nbformat.v4.new_notebook(cells=[begin]), timeout=SECONDS, resources=place)
    client.execute(env=environment, cleanup_kc=False)
    yield client
    with client.setup_kernel():  # which ends it
        pass


@each_notebook
def test_runs(path, kernel):
    notebook = nbformat.reads(path.read_text(encoding="utf-8"), as_version=4)
    # What JAX keeps is frozen, as %reset collects garbage twice, which takes 0.1 s and more over all that.
    notebook.cells.insert(0, nbformat.v4.new_code_cell("import gc; gc.freeze()\n%reset -f"))
    kernel.nb = notebook
    kernel.execute(cleanup_kc=False)
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [output.text for output in outputs if "Warning" in output.get("text", "")]
    assert any("image/png" in output.get("data", {}) for output in outputs)


@each_notebook
def test_is_committed_as_it_was_written(path):
    """No outputs, no counts; cells with names of their own, so that a change to one is a change to one."""
    text = path.read_text(encoding="utf-8")
    notebook = nbformat.reads(text, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.outputs == [] and cell.execution_count is None for cell in code), "clear all outputs"
    assert all(cell.metadata == {} for cell in notebook.cells), "clear the cells' metadata"
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert set(notebook.metadata.language_info) == {"name"}
    assert all(cell.id.replace("-", "").isalpha() for cell in notebook.cells), "give every cell's id a name"
    assert text == nbformat.writes(notebook) + "\n", "write it as nbformat does"


@each_notebook
def test_first_cell_says_what_is_compiled_and_how_large(path):
    first = next(cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code").source
    assert "runtime.use_compilation_cache()" in first
    assert '"COOPMM_SMALL" in os.environ' in first
    others = path.read_text(encoding="utf-8").count("use_fast_compilation(") - first.count("use_fast_compilation(")
    assert others == 0, "it comes too late after the first computation"


def test_readme_lists_every_experiment_once():
    text = (EXPERIMENTS / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(?:python -m )?(.+?)` \| .+ \|$", text, flags=re.MULTILINE)
    scripts = (path.relative_to(EXPERIMENTS.parent) for path in EXPERIMENTS.rglob("*.py"))
    wanted = [".".join(path.with_suffix("").parts) for path in scripts if path.stem != "__init__"]
    wanted += [*list_scenarios(), *(path.name for path in NOTEBOOKS)]
    assert sorted(rows) == sorted(wanted)
