"""The whole state of a tuning run after an iteration: what is read back goes on as if nothing had happened.

>>> import tempfile
>>> with tempfile.TemporaryDirectory() as folder:
...     write(Path(folder), {"iteration": np.array(3)}, "settings")
...     int(read(Path(folder), "settings")["iteration"])
3
"""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.files import write_npz

NAME = "state.npz"
_SETTINGS = "settings"


def write(folder: Path, arrays: dict[str, np.ndarray], settings: str) -> None:
    """Replace the folder's state by another, in one step: there is always a complete one.

    Args:
        arrays: the state (...) by name. settings: everything that the course of the run depends on, as text.
    """
    write_npz(folder / NAME, arrays | {_SETTINGS: np.array(settings)})


def read(folder: Path, settings: str) -> dict[str, np.ndarray]:
    """The folder's state, arrays (...) by name.

    Raises:
        UserError: there is none, it cannot be read, or it was made with other settings.
    """
    path = folder / NAME
    try:
        with np.load(path) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError:
        raise UserError("--resume", f"used with a folder that has a {NAME}", folder) from None
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise UserError("--resume", f"used with a {NAME} that can be read", f"{path} ({error})") from None
    _same(str(arrays.pop(_SETTINGS)), settings)
    return arrays


def _same(before: str, now: str) -> None:
    """Compare settings line by line; the first difference is named."""
    old, new = before.splitlines(), now.splitlines()
    for a, b in zip(old, new):
        if a != b:
            raise UserError("--resume", f"used with the settings of the run: {a}", b)
    if len(old) != len(new):
        raise UserError("--resume", f"used with the settings of the run ({len(old)} lines)", f"{len(new)} lines")
