"""Commands and blocks of Python in a page of Markdown, and what comes of carrying them out."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import jax

from tests import pages_worker

ROOT = Path(__file__).parent.parent


def commands(text):
    """Commands in the code of a page, each once: code spans, indented lines, fenced blocks that are not Python."""
    text = re.sub(r"^```python\n.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^```\w*\n(.*?)^```$", lambda m: re.sub("^", "    ", m[1], flags=re.M), text, flags=re.M | re.S)
    code = (a or b for a, b in re.findall(r"^ {4}(.+)$|`([^`\n]+)`", text, flags=re.MULTILINE))
    lines = (shlex.join(shlex.split(line, comments=True)) for line in code if re.match(r"(coopmm|python|make) ", line))
    return list(dict.fromkeys(lines))


def lines(text):
    """Commands of a page that stand in lines of their own."""
    whole = re.sub(r"^```\w*\n.*?^```$", "", text, flags=re.M | re.S)
    return re.findall(r"^ {4}((?:coopmm|make|pip) .*)$", whole, flags=re.M)


def blocks(text):
    """The blocks of Python."""
    return re.findall(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


def carried_out(*readers):
    """For each reader, command or block -> what came of it; all in one process, which compiles what they share once.

    Args:
        readers: of each, a folder to work in, and jobs as ``pages_worker`` takes them.
    """
    own = {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", pages_worker.__name__],
        input=json.dumps([(str(folder), jobs) for folder, jobs in readers]),
        env=os.environ | own,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = zip(readers, json.loads(done.stdout), strict=True)
    return [dict(zip([text for _, text, _ in jobs], results, strict=True)) for (_, jobs), results in found]
