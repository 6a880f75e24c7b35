"""The folder of a tuning run: its state after every iteration, from which it goes on as if nothing had happened.

>>> import tempfile
>>> with tempfile.TemporaryDirectory() as folder:
...     write(Path(folder), {"iteration": np.array(3)}, "settings")
...     int(read(Path(folder), "settings")["iteration"])
3
"""

from __future__ import annotations

import contextlib
import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.files import locked_folder, read_npz, resolve_path, write_csv, write_npz
from coopmm_jax.kinds.software import check_plugins, record, recorded_plugins, versions
from coopmm_jax.runtime import xla_options

if TYPE_CHECKING:
    from tuning.studies.result import Row

NAME, HISTORY, SETTINGS, GAINS = "state.npz", "history.csv", "scenario.toml", "gains.toml"
_KEY = "settings"


@contextlib.contextmanager
def run_folder(out: str | Path | None, resume: bool, overwrite: bool = False) -> Iterator[Path | None]:
    """The folder of a run, which is this process's alone; a new one goes again if nothing is written.

    Args:
        out: the folder; None: nothing is kept.
        resume: it has a run to go on with.
        overwrite: it may have a run, which ``clear`` is going to remove.

    Raises:
        UserError: it has a run that is not to be resumed, or none that is, or it cannot be used.
    """
    if out is None:
        yield None
        return
    folder = resolve_path(out, "--out")
    if resume and not folder.is_dir():
        raise UserError("--resume", f"used with a folder that has a {NAME}", folder)
    with locked_folder(folder):
        if not (resume or overwrite) and (folder / NAME).exists():
            raise UserError("--out", "a folder without a tuning run, or --resume or --overwrite given", folder)
        yield folder


def clear(folder: Path) -> None:
    """Remove a run, so that nothing of it can be taken for a part of the next."""
    for name in (NAME, HISTORY, GAINS):
        (folder / name).unlink(missing_ok=True)


def write_history(folder: Path, history: Sequence[Row]) -> None:
    """Write history.csv anew."""
    write_csv(folder / HISTORY, history[0]._fields, history)


def append_history(folder: Path, row: Row) -> None:
    """Add a line to history.csv, in one piece: whatever kills the process, the file has whole lines."""
    path = folder / HISTORY
    text = _line(row) if path.exists() else _line(row._fields) + _line(row)
    with path.open("a", encoding="utf-8", newline="") as stream:
        stream.write(text)


def _line(values: Sequence) -> str:
    text = io.StringIO()
    csv.writer(text).writerow(values)
    return text.getvalue()


def write(folder: Path, arrays: dict[str, np.ndarray], settings: str) -> None:
    """Replace the folder's state by another, in one step: there is always a complete one.

    Args:
        folder: of the run.
        arrays: the state (...) by name.
        settings: everything that the course of the run depends on, as text.
    """
    write_npz(folder / NAME, arrays | {_KEY: np.array(_complete(settings))})


def read(folder: Path, settings: str) -> dict[str, np.ndarray]:
    """The folder's state, arrays (...) by name.

    Raises:
        UserError: there is none, it cannot be read, or it was made with other settings.
    """
    path = folder / NAME
    if not path.exists():
        raise UserError("--resume", f"used with a folder that has a {NAME}", folder)
    try:
        arrays = read_npz(path)
        before = str(arrays.pop(_KEY))
    except (KeyError, ValueError) as error:
        raise UserError("--resume", f"used with a {NAME} that can be read", f"{path} ({error})") from None
    check_plugins(recorded_plugins(before), "--resume", folder)
    _same(before, _complete(settings))
    return arrays


def _complete(settings: str) -> str:
    """Settings, and the software and compiler options that the bits depend on too."""
    software = versions() | {"XLA_FLAGS": xla_options()}
    return f"{settings.rstrip()}\n{record(software)}"


def _same(before: str, now: str) -> None:
    """Compare settings line by line; the first difference is named."""
    old, new = before.splitlines(), now.splitlines()
    for a, b in zip(old, new):
        if a != b:
            raise UserError("--resume", f"used with the settings of the run: {a}", b)
    if len(old) != len(new):
        raise UserError("--resume", f"used with the settings of the run ({len(old)} lines)", f"{len(new)} lines")
