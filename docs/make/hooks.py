"""Pages of the documentation that are made of the package itself, each time it is built: none can be out of date."""

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
"""Where the theme would load it from."""
CODE, OPTION = re.compile(r"<code>[^<]*</code>"), re.compile(r"(?<![\w-])--?[a-z][\w-]*")
"""Code in a sentence, and an option in it."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Lists the generated pages in the navigation, where mkdocs.yml has the first of their kind."""
    lists = {
        "reference/api.md": [f"reference/{name}.md" for name in gp.__all__],
        "effects/index.md": [f"effects/{family.name}.md" for family in gp.catalogue],
        "validation/index.md": [p for p in experiments_pages.pages(ROOT) if p.endswith(".md")],
    }
    config.nav = [_with(item, lists) for item in config.nav or ()]
    return config


def _with(item: object, lists: Mapping[str, list[str]]) -> object:
    """An entry of the navigation; one that leads to the first page of a list has all of it below."""
    if isinstance(item, dict):
        return {title: _with(inside, lists) for title, inside in item.items()}
    if isinstance(item, list):
        return [_with(inside, lists) for inside in item]
    return [item, *lists[item]] if item in lists else item


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the generated pages and pictures to those of docs/."""
    made: list[Mapping[str, str | bytes]] = [commands.pages(), public_names.pages(), effects.pages()]
    made += [experiments_pages.pages(ROOT), gallery_page.pages(), documents()]
    for pages in made:
        for path, content in pages.items():
            files.append(File.generated(config, path, content=content))
    return files


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Keeps the names of options in a sentence whole: a browser breaks lines after a hyphen."""
    return CODE.sub(lambda code: OPTION.sub(r'<span class="option">\g<0></span>', code[0]), html)


def on_post_template(output: str, template_name: str, config: MkDocsConfig) -> str:
    """The same of the page that a server shows where there is none."""
    return output.replace(WORKER, "/iframe-worker.js")


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Has the search of pages that are opened as files load its worker from beside them, not from the network."""
    return output.replace(WORKER, get_relative_url("iframe-worker.js", page.url))


def documents() -> dict[str, str]:
    """CONTRIBUTING.md and CHANGELOG.md as pages, their links led to the pages of the site."""
    named = {"contributing.md": "CONTRIBUTING.md", "changes.md": "CHANGELOG.md"}
    return {page: (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](") for page, name in named.items()}
