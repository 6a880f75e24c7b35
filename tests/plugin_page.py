"""The page on plugins: its files, its commands, and its table of groups, which is printed from the registry.

    python -m tests.plugin_page

writes the table into docs/plugins.md, between its markers.
"""

import pkgutil
import re
from importlib import import_module
from pathlib import Path

from coopmm_jax import kinds as package
from coopmm_jax.kinds.protocol import MISSING
from coopmm_jax.kinds.registry import GROUPS
from coopmm_jax.metrics import table as metrics  # registers the built-in ones

PAGE = Path(__file__).parent.parent / "docs" / "plugins.md"
BEGIN, END = "<!-- groups: from tests/plugin_page.py -->\n", "<!-- end of groups -->"
assert metrics
for module in pkgutil.iter_modules(package.__path__):
    import_module(f"{package.__name__}.{module.name}")


def files(text: str) -> dict[str, str]:
    """Files of the page by name: the blocks that begin with one."""
    found = re.findall(r"^```(?:python|toml)\n# (\S+)\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    return dict(found)


def table() -> str:
    """Protocols of all groups, in Markdown."""
    lines = []
    for name, group in sorted(GROUPS.items()):
        lines += [f"**{name}**: {group.meaning}", ""]
        for method in group.methods:
            form = f"{method.name}({', '.join(('self', *method.arguments))})"
            lines.append(f"- `{form}`{', optional' if method.optional else ''}: {method.meaning}")
        for attribute in group.attributes:
            values = attribute.allowed
            allowed = "" if isinstance(values, type) else ": " + ", ".join(f"`{value}`" for value in values)
            default = (
                "" if attribute.default is MISSING else f" (default `{attribute.default or repr(attribute.default)}`)"
            )
            lines.append(f"- `{attribute.name} = ...`: {attribute.meaning}{allowed}{default}")
        lines.append("")
    return "\n".join(lines)


def written(text: str) -> str:
    """The page with the table between its markers."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}{table()}{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
