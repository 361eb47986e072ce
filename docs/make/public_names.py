"""Make the reference of the library: a page for every public name, with an example that the tests run."""

from importlib import import_module
from pathlib import Path

import gpmodel as gp

EXAMPLES = Path(__file__).with_name("examples.py")
TITLES = {
    "Data and machines": ("load_mechanism", "read_table", "check", "simulate", "choose_poses"),
    "Fitting and searching": ("calibrate", "discover", "evolve", "regress", "fleet"),
    "Results": ("load_result", "Model", "load_model", "verify", "compare", "certificate", "export", "explain"),
}
"""Headings of the public names; a name without a heading is a setting, or a part of effects or mechanisms."""
OTHERS = "Settings, effects and mechanisms"


def examples() -> dict[str, str]:
    """Return {public name: lines of its example}, the lines in examples.py between `# name: ...` comments."""
    found: dict[str, str] = {}
    for block in EXAMPLES.read_text(encoding="utf-8").split("\n# ")[1:]:
        head, _, lines = block.partition("\n")
        found[head.partition(":")[0]] = lines.strip()
    return found


def pages() -> dict[str, str]:
    """Return the overview of public names, and a page for each name, by path."""
    listed = {name for names in TITLES.values() for name in names}
    groups = {title: [n for n in names if n in gp.__all__] for title, names in TITLES.items()}
    groups[OTHERS] = [name for name in gp.__all__ if name not in listed]
    shown = examples()
    made = {f"reference/{name}.md": _page(name, shown.get(name, "")) for name in gp.__all__}
    made["reference/api.md"] = _overview(groups)
    return made


def _page(name: str, example: str) -> str:
    path = _path(name)
    text = f"# {name}\n\n"
    if example:
        text += f"```python\n{example}\n```\n\n"
    return f"{text}::: {path}\n"


def _path(name: str) -> str:
    """Return the dotted path of the definition of a public name."""
    home = gp._HOME[name]
    return f"gpmodel.{home}.{name}"


def _overview(groups: dict[str, list[str]]) -> str:
    lines = [
        "# The library",
        "",
        "`import gpmodel as gp` loads nothing else; every name is imported when it is first asked for. Results have",
        "`summary()`, `report(folder)`, `save(file)` and, where rows make sense, `to_dataframe()`. Bad input is a",
        "[`gp.InputError`](InputError.md) of one line. The tests run the examples of these pages.",
    ]
    for title, names in groups.items():
        lines += ["", f"## {title}", "", "| name | what it is |", "|---|---|"]
        lines += [f"| [`gp.{name}`]({name}.md) | {_first_line(name)} |" for name in names]
    return "\n".join(lines) + "\n"


def _first_line(name: str) -> str:
    module = import_module(f"gpmodel.{gp._HOME[name]}")
    value = getattr(module, name)
    if isinstance(value, tuple):
        return f"the {len(value)} families of effects that come with the package"
    text = (value.__doc__ or "").strip().split("\n\n")[0]
    sentence = " ".join(text.split()).partition(". ")[0].rstrip(".")
    return sentence.replace("|", "\\|")
