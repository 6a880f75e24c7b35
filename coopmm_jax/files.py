"""Files and folders that are written whole or not at all, and the paths that users name.

>>> import tempfile
>>> with tempfile.TemporaryDirectory() as parent:
...     with result_folder(Path(parent) / "run") as folder:
...         write_json(folder / "summary.json", {"force": math.nan})
...     (Path(parent) / "run" / "summary.json").read_text()
'{\\n  "force": null\\n}\\n'
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
import secrets
import shutil
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from coopmm_jax.errors import UserError

if TYPE_CHECKING:
    import numpy as np

_UNFINISHED: set[Path] = set()  # what is to go if the process ends now
LOCK = ".lock"  # in a folder in which a process works
_SHOWN = 40  # characters of a target's name in that of its temporary file: names have a limit


def resolve_path(text: str | Path, option: str) -> Path:
    """The path that a user means: ``~``, ``~user`` and environment variables are replaced, and it ends in a name.

    What exists under the name as it is written is meant as it is.

    Args:
        text: as the user wrote it, absolute or relative to the working folder.
        option: where the user wrote it, for the error.

    Raises:
        UserError: no file can have this path, or there is no such user.

    >>> resolve_path(".", "--out") == Path.cwd()
    True
    >>> resolve_path("~nobody-of-this-name/x", "--out")
    Traceback (most recent call last):
    coopmm_jax.errors.UserError: --out: must be a path of an existing user's folder, was ~nobody-of-this-name/x
    """
    written = os.fspath(text)
    if not written or "\0" in written:
        raise UserError(option, "a path", repr(written))
    there = os.path.lexists(written)
    expanded = written if there else os.path.expanduser(os.path.expandvars(written))
    if expanded.startswith("~") and not there:
        raise UserError(option, "a path of an existing user's folder", written)
    path = Path(expanded)
    return path.resolve() if path.name in ("", "..") else path


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A stream for the content of a file, which takes the place of ``path`` when the ``with`` block ends well."""
    partial = _partial(path.parent, path.name)
    _UNFINISHED.add(partial)
    try:
        with partial.open("xb") as stream:  # never through a link that stands there already
            yield stream
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    finally:
        _UNFINISHED.discard(partial)


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8."""
    with whole_file(path) as stream:
        stream.write(text.encode("utf-8"))


def write_json(path: Path, content: Any) -> None:
    """Write strict JSON: NumPy's numbers as numbers, what is not finite as null."""
    write_text(path, json.dumps(_plain(content), indent=2, allow_nan=False) + "\n")


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a table with a line of names."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(header)
    writer.writerows(rows)
    write_text(path, text.getvalue())


def write_npz(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays of any shape (...) by name."""
    import numpy as np

    by_name: dict[str, Any] = dict(arrays)
    with whole_file(path) as stream:
        np.savez(stream, **by_name)


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Arrays of any shape (...) by name, of a file that may be damaged or something else altogether.

    Raises:
        ValueError: whatever is wrong with it, in a few words.
    """
    import numpy as np

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as found:
                return {name: found[name] for name in found.files}
    except Exception as error:  # zipfile, zlib and NumPy have many
        raise ValueError(_short(error)) from None


def read_json(path: Path) -> Any:
    """Content of a JSON file that may be damaged or something else altogether.

    Raises:
        ValueError: whatever is wrong with it, in a few words.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(_short(error)) from None


def _short(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


@contextlib.contextmanager
def hidden_folder(place: Path, name: str) -> Iterator[Path]:
    """An empty folder in ``place`` for what is to get another name when it is complete; gone when the block ends."""
    hidden = _partial(place, name)
    _UNFINISHED.add(hidden)
    try:
        hidden.mkdir()
        yield hidden
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
        _UNFINISHED.discard(hidden)


def abandon() -> None:
    """Remove what is unfinished, as the process is about to end without a word to whoever writes it."""
    for path in tuple(_UNFINISHED):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def result_folder(target: str | Path, option: str = "--out") -> Iterator[Path]:
    """A folder to write results into; they appear in ``target`` only when the ``with`` block ends without an exception.

    Entering it already creates a hidden folder beside the target, so an unusable target is found before a long
    run, not after. In a target that exists, files of the same name are replaced and others left alone.

    Args:
        target: the folder the results are for; its parents are made as needed.
        option: what the user knows the target as, for the error.

    Yields:
        A folder inside the hidden one.

    Raises:
        UserError: the target cannot be written.
    """
    target = resolve_path(target, option).absolute()
    with _beside(target, option) as hidden:
        yield hidden
        try:
            _publish(hidden, target)
        except OSError as error:
            must = f"a folder in which {Path(error.filename2 or target).name} can be written"
            raise UserError(option, must, f"{target} ({error.strerror})") from None


def check_unused(target: Path, option: str, *, file: bool = False, help_by: str = "--overwrite") -> None:
    """Refuse a place where results stand already.

    Args:
        target: where new ones are to be written.
        option: what the user knows the target as, for the error.
        file: it is to be a file, not a folder; a folder may be there, but with nothing in it that is not hidden.
        help_by: options that allow what is refused.

    Raises:
        UserError: there is such a file, or such a folder.
    """
    inside = target.iterdir() if target.is_dir() and not file else ()
    if (file and target.is_file()) or any(not path.name.startswith(".") for path in inside):
        raise UserError(option, f"a place without results, or {help_by} given", target)


def check_folder(target: str | Path, option: str = "--out") -> None:
    """Find out before a long run whether results can be written.

    Args:
        target: the folder the results are for.
        option: what the user knows the target as, for the error.

    Raises:
        UserError: the target cannot be written.
    """
    with _beside(resolve_path(target, option).absolute(), option):
        pass


@contextlib.contextmanager
def _beside(target: Path, option: str) -> Iterator[Path]:
    """A hidden folder in a folder of results, or where it is going to be."""
    if target.is_symlink() and not target.exists():
        raise UserError(option, "a folder that can be written", f"{target} (a link to nothing)")
    with contextlib.ExitStack() as stack:
        try:
            hidden = stack.enter_context(hidden_folder(_nearest(target), target.name))
        except OSError as error:
            raise UserError(option, "a folder that can be written", f"{target} ({error.strerror})") from None
        yield hidden


@contextlib.contextmanager
def locked_folder(folder: Path, option: str = "--out", name: str = LOCK) -> Iterator[None]:
    """Keep other processes from working in a folder, which is made if needed and goes again if it stays empty.

    Args:
        folder: of the results.
        option: what the user knows the folder as, for the error.
        name: of the lock; processes that share a folder on purpose have different ones.

    Raises:
        UserError: another process works in it, or it cannot be written.
    """
    from filelock import FileLock, Timeout

    new = not folder.exists()
    lock = FileLock(folder / name, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise UserError(option, "a folder that no other process is working in", folder) from None
    except OSError as error:
        raise UserError(option, "a folder that can be written", f"{folder} ({error.strerror})") from None
    try:
        yield
    finally:
        (folder / name).unlink(missing_ok=True)  # while it is held: whoever has it open already sees that it is gone
        lock.release()
        if new and not any(folder.iterdir()):
            folder.rmdir()


def _partial(place: Path, name: str) -> Path:
    return place / f".{name[:_SHOWN]}-{secrets.token_hex(8)}.partial"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _nearest(target: Path) -> Path:
    """A folder on the target's file system: the target if it exists, else its nearest existing parent."""
    while not target.exists():
        target = target.parent
    return target


def _publish(results: Path, target: Path) -> None:
    """Give results their name: all at once where nothing has it yet, else file by file."""
    if not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        results.rename(target)
        return
    for path in sorted(path for path in results.rglob("*") if path.is_file()):
        final = target / path.relative_to(results)
        final.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, final)
