"""The documentation as it is built: no warning, no broken link inside, nothing from outside, all public names."""

from __future__ import annotations

import importlib
import re
import shutil
from html.parser import HTMLParser
from inspect import getdoc, isclass, isfunction
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from docs.api_pages import FIRST, PARTS, public_names
from tests.helpers.processes import run_python
from tests.helpers.trials import briefly

ROOT = Path(__file__).resolve().parents[3]
DOCS = ROOT / "docs"


class Page(HTMLParser):
    """What a page links to, what it loads, and which places in it can be linked to."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.places: set[str] = set()
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value for name, value in attrs if value is not None}
        self.places |= {given[name] for name in ("id", "name") if name in given}
        if "href" in given:
            (self.loads if tag == "link" else self.links).append(given["href"])
        if "src" in given:
            self.loads.append(given["src"])


BARE = """
from sphinx.builders.html import StandaloneHTMLBuilder

html_theme, html_theme_options = "basic", {}
StandaloneHTMLBuilder.search = False
smartquotes = html_use_index = html_domain_indices = html_copy_source = False
"""
"""A theme without a tree of all pages on each, which takes longer than all else; the own one is looked at apart.

Nor is there an index of all words for the search, or one of all names; no quotation mark is made round, and no source
is copied.
"""
PLOT = "import matplotlib.pyplot as plt\n\nplt.figure(figsize=(1, 1))\n"
PLANNING = 0.1
"""Seconds that a drawing may plan."""


def build(folder: Path, *options: str) -> Path:
    """Return where the pages of ``docs`` in a folder are, built without a warning."""
    words = ["-m", "sphinx", "-W", "--keep-going", "-q", *options, "docs", "pages"]
    done = run_python(words, cwd=folder, timeout=900.0)
    assert done.returncode == 0, done.stderr
    return folder / "pages"


def test_the_theme_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    pytest.importorskip("sphinx_gallery", reason="the extra docs is not installed")
    settings = re.findall(r"^html_\w+ = .*$", (DOCS / "conf.py").read_text(), flags=re.M)
    assert 'html_theme = "furo"' in settings
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "conf.py").write_text("\n".join(['extensions = ["myst_parser"]', *settings]))
    (tmp_path / "docs" / "index.md").write_text("# Title\n\n```{toctree}\nother\n```\n")
    (tmp_path / "docs" / "other.md").write_text("# Other\n\nA [link](index.md).\n")
    built = build(tmp_path)
    pages = {file: Page(file) for file in built.rglob("*.html")}
    assert any("furo" in link for link in pages[built / "index.html"].loads)
    assert not [fault for file, page in pages.items() for fault in faults_of(file, page, pages)]


def test_the_pages_are_whole(tmp_path: Path) -> None:
    """They are made of a copy, since Sphinx writes beside its sources.

    test_examples.py runs the examples, and tests/unit/docs/test_docs.py what the figures of the pages show.
    """
    pytest.importorskip("sphinx_gallery", reason="the extra docs is not installed")
    shutil.copytree(
        DOCS, tmp_path / "docs", symlinks=True, ignore=shutil.ignore_patterns("api", "gallery", "__pycache__")
    )
    for beside in ("benchmarks", "examples", "src"):
        (tmp_path / beside).symlink_to(ROOT / beside)
    with (tmp_path / "docs" / "conf.py").open("a") as conf:
        conf.write(BARE)
    for file in (tmp_path / "docs").rglob("*.md"):
        text = file.read_text()
        if "```{plot}" in text:
            file.write_text(re.sub(r"^```\{plot\}\n.*?^```$", f"```{{plot}}\n{PLOT}```", text, flags=re.S | re.M))
    for file in (tmp_path / "docs" / "drawings").glob("*.py"):
        file.write_text(briefly(file.read_text(), PLANNING))
    built = build(tmp_path, "-D", "plot_gallery=0")

    pages = {file: Page(file) for file in built.rglob("*.html")}
    assert len(pages) >= 40
    links = [link for file, page in pages.items() for link in faults_of(file, page, pages)]
    assert not links, links[:20]
    assert sum(len(page.links) for page in pages.values()) > 1000
    places = {part: pages[built / "api" / f"{part}.html"].places for part in public_names()}
    assert not [
        f"{part}.{name}"
        for part, names in public_names().items()
        for name in names
        if not name.startswith("__") and f"{part}.{name}" not in places[part]
    ]


def faults_of(file: Path, page: Page, pages: dict[Path, Page]) -> list[str]:
    """Return the links that lead nowhere, and what a page loads from other machines."""
    found = []
    for link in page.links + page.loads:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            if link in page.loads and parts.scheme != "data":
                found.append(f"{file.name} loads {link}")
            continue
        target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
        if not target.exists():
            found.append(f"{file.name}: {link}")
        elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].places:
            found.append(f"{file.name}: {link}, no such place")
    return found


def test_the_reference_lists_its_pages_as_one_meets_them() -> None:
    listed = re.findall(r"^\.\./api/(\S+)$", (DOCS / "reference" / "api.md").read_text(), flags=re.M)
    assert listed == list(PARTS)
    assert set(FIRST) <= set(public_names()["trailmark"])


def test_every_public_name_and_what_is_public_in_it_is_described() -> None:
    bare, seen = [], 0
    for part, names in public_names().items():
        module = importlib.import_module(part)
        for name in names:
            value = getattr(module, name)
            if not (isclass(value) or isfunction(value)):
                continue
            inside = {f"{name}.{key}": member for key, member in vars(value).items()} if isclass(value) else {}
            public = {key: member for key, member in inside.items() if "._" not in key}
            described = {
                key: getattr(member, "__func__", member)
                for key, member in public.items()
                if isfunction(member) or isinstance(member, property | classmethod | staticmethod)
            }
            for key, member in {name: value, **described}.items():
                seen += 1
                text = getdoc(member)
                # A dataclass without words of its own is described by its signature.
                if not text or text.startswith(f"{key}("):
                    bare.append(f"{part}.{key}")
    assert seen > 300
    assert not bare


def test_every_page_is_in_the_table_of_contents() -> None:
    contents = (DOCS / "index.md").read_text()
    pages = [page.relative_to(DOCS).with_suffix("") for page in DOCS.rglob("*.md")]
    own = [page for page in pages if page.parts[0] not in {"index", "gallery", "api"}]
    assert len(own) >= 25
    assert all(f"\n{page}\n" in contents for page in own)
