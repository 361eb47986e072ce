"""Make the pages of the benchmarks from the README and the figures of every experiment."""

import re
import subprocess
from pathlib import Path

LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")


def pages(root: Path) -> dict[str, str | bytes]:
    """Return pages and pictures by path in the site: validation/NAME.md and validation/NAME/figures/..."""
    home = root / "experiments"
    made: dict[str, str | bytes] = {"validation/experiments.md": _rewritten(home / "README.md", home, "")}
    for readme in sorted(home.glob("*/README.md")):
        name = readme.parent.name
        made[f"validation/{name}.md"] = _rewritten(readme, home, _date(readme))
    for figure in sorted(home.glob("*/figures/*")):
        if figure.suffix in (".png", ".svg"):
            made[f"validation/{figure.relative_to(home).as_posix()}"] = figure.read_bytes()
    return made


def _date(readme: Path) -> str:
    """Return the date of the last commit of an experiment's results; empty without history."""
    results = sorted(p.name for p in readme.parent.glob("*.json")) or [readme.name]
    done = subprocess.run(
        ["git", "log", "-1", "--format=%cs", "--", *results], cwd=readme.parent, capture_output=True, text=True
    )
    return f"*Results of {done.stdout.strip()}.*\n\n" if done.returncode == 0 and done.stdout.strip() else ""


def _rewritten(readme: Path, home: Path, note: str) -> str:
    """Redirect links to READMEs and figures to the pages of the site; other links to files become plain code."""

    def link(match: re.Match[str]) -> str:
        picture, text, target = match.groups()
        path, _, anchor = target.partition("#")
        if target.startswith(("http", "#")):
            return match.group(0)
        found = (readme.parent / path).resolve()
        if picture and found.is_relative_to(home) and found.is_file():
            return f"![{text}]({found.relative_to(home).as_posix()})"
        page = found / "README.md" if found.is_dir() else found
        if page.name == "README.md" and page.is_file() and page.parent.parent == home:
            return f"[{text}]({page.parent.name}.md{'#' + anchor if anchor else ''})"
        if page == home / "README.md":
            return f"[{text}](experiments.md{'#' + anchor if anchor else ''})"
        return f"{text} (`{found.relative_to(home.parent).as_posix()}`)" if found.exists() else text

    content = LINK.sub(link, readme.read_text(encoding="utf-8"))
    title, _, rest = content.partition("\n")
    return f"{title}\n\n{note}{rest}"
