"""A page for each shipped scenario: its picture, its file, and how to run it."""

from __future__ import annotations

from coopmm_jax.scenario.scenario import list_scenarios, load_scenario, shipped


def pages() -> dict[str, str | bytes]:
    """Pages by path; the first one lists the scenarios."""
    described = list_scenarios()
    rows = [f"| [`{name}`]({name}.md) | {text} |" for name, text in described.items()]
    overview = ["# Shipped scenarios", "", "| name | what |", "| --- | --- |", *rows, ""]
    pages: dict[str, str | bytes] = {"scenarios/index.md": "\n".join(overview)}
    return pages | {f"scenarios/{name}.md": _page(name, text) for name, text in described.items()}


def _page(name: str, description: str) -> str:
    scenario = load_scenario(name)
    file = shipped()[name].read_text(encoding="utf-8")
    required = ", ".join(f"`{requirement}`" for requirement in scenario.requirements.parsed()) or "nothing"
    varied = ", ".join(f"`{entry.name}`" for entry in scenario.uncertainty.entries()) or "nothing"
    commands = [f"coopmm simulate {name} --out results/{name}"]
    if scenario.uncertainty.entries():
        commands += [f"coopmm sweep {name} --samples 1000 --out results/{name}.zarr"]
        commands += [f"coopmm tune {name} --out results/{name}-tuned"]
    commands += [f"coopmm init mine.toml --scenario {name}"]
    shown = "\n".join(f"    {command}" for command in commands)
    return (
        f"# {name}\n\n{description}.\n\n![{name}](../{name}.png)\n\n{shown}\n\n"
        f"Uncertain from sample to sample: {varied}. Required of every sample: {required}.\n\n"
        f"## The file\n\n`coopmm scenarios {name} --whole` prints it with all that it takes from its base.\n\n"
        f"```toml\n{file.rstrip()}\n```\n"
    )
