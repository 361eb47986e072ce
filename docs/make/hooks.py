"""Hooks of mkdocs that generate pages of the documentation from the package at every build."""

import re
import sys
from collections.abc import Mapping
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from mkdocs.utils import get_relative_url

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import commands  # noqa: E402
import effects  # noqa: E402
import experiments_pages  # noqa: E402
import gallery_page  # noqa: E402
import public_names  # noqa: E402

import gpmodel as gp  # noqa: E402

WORKER = "https://unpkg.com/iframe-worker/shim"
"""Address from which the mkdocs theme would load the search worker."""
CODE, OPTION = re.compile(r"<code>[^<]*</code>"), re.compile(r"(?<![\w-])--?[a-z][\w-]*")
"""Patterns of code in a sentence of a page, and of a command-line option in the code."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the generated pages in the navigation, at the place of the first page of each kind in mkdocs.yml."""
    lists = {
        "reference/api.md": [f"reference/{name}.md" for name in gp.__all__],
        "effects/index.md": [f"effects/{family.name}.md" for family in gp.catalogue],
        "validation/index.md": [p for p in experiments_pages.pages(ROOT) if p.endswith(".md")],
    }
    config.nav = [_with(item, lists) for item in config.nav or ()]
    return config


def _with(item: object, lists: Mapping[str, list[str]]) -> object:
    """Return an entry of the navigation; an entry of the first page of a list contains the whole list."""
    if isinstance(item, dict):
        return {title: _with(inside, lists) for title, inside in item.items()}
    if isinstance(item, list):
        return [_with(inside, lists) for inside in item]
    return [item, *lists[item]] if item in lists else item


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages and pictures to the files of docs/."""
    made: list[Mapping[str, str | bytes]] = [commands.pages(), public_names.pages(), effects.pages()]
    made += [experiments_pages.pages(ROOT), gallery_page.pages(), documents()]
    for pages in made:
        for path, content in pages.items():
            files.append(File.generated(config, path, content=content))
    return files


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Prevent line breaks within names of options, which a browser would insert after a hyphen."""
    return CODE.sub(lambda code: OPTION.sub(r'<span class="option">\g<0></span>', code[0]), html)


def on_post_template(output: str, template_name: str, config: MkDocsConfig) -> str:
    """Let the search of the error page load its worker from the root of the site."""
    return output.replace(WORKER, "/iframe-worker.js")


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Let the search load its worker from the site's files, not from the network."""
    return output.replace(WORKER, get_relative_url("iframe-worker.js", page.url))


def documents() -> dict[str, str]:
    """Return CONTRIBUTING.md and CHANGELOG.md as pages, with links to the pages of the site."""
    named = {"contributing.md": "CONTRIBUTING.md", "changes.md": "CHANGELOG.md"}
    return {page: (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](") for page, name in named.items()}
