"""Notebooks as pages, in reading order, with what they showed when they were run.

``make docs`` runs them into build/notebooks and builds the site after that. Without that folder the pages have the
notebooks' text and code alone, which is what the tests build: they run the notebooks themselves, at small size.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
NOTEBOOKS, EXECUTED = ROOT / "experiments" / "notebooks", ROOT / "build" / "notebooks"
ORDER = (
    *("first_contact", "control_law", "robustness_sweep", "gain_tuning"),
    *("own_optimiser", "extending", "another_robot", "proof_step_39"),
)


def pages() -> dict[str, str | bytes]:
    """Pages and figures by path."""
    from nbconvert import MarkdownExporter  # takes a second to import

    exporter = MarkdownExporter()
    found: dict[str, str | bytes] = {}
    for number, name in enumerate(names(), 1):
        executed = EXECUTED / f"{name}.ipynb"
        source = executed if executed.exists() else NOTEBOOKS / f"{name}.ipynb"
        text, resources = exporter.from_filename(str(source))
        outputs = {f"{name}_{file}": data for file, data in resources["outputs"].items()}
        for file in resources["outputs"]:
            text = text.replace(f"]({file})", f"]({name}_{file})")
        found[f"tutorials/{name}.md"] = _numbered(text, number, name, source == executed)
        found |= {f"tutorials/{file}": data for file, data in outputs.items()}
    return found


def names() -> list[str]:
    """Notebooks in reading order; those that it does not name come last."""
    there = sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb"))
    return sorted(there, key=lambda name: ORDER.index(name) if name in ORDER else len(ORDER))


def _numbered(text: str, number: int, name: str, executed: bool) -> str:
    """Page with its number in the heading and the notebook it comes from below it; tables without styles."""
    text = re.sub(r"<style scoped>.*?</style>", "", text, flags=re.DOTALL)
    heading, _, rest = text.lstrip().partition("\n")
    note = f"The notebook `experiments/notebooks/{name}.ipynb`{', as it ran for this page' if executed else ''}."
    return f"# {number}. {heading.removeprefix('# ')}\n\n{note}\n{rest}"
