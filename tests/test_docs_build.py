"""The documentation as it is built: no warning, no broken link inside, nothing from outside, all public names."""

from __future__ import annotations

import os
import subprocess
import sys
from html.parser import HTMLParser
from inspect import getdoc, isclass, isfunction
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

ROOT = Path(__file__).resolve().parents[1]
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


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages; tests/test_examples.py runs the examples, so the gallery is made without."""
    pytest.importorskip("sphinx_gallery", reason="the extra docs is not installed")
    pages, trees = tmp_path_factory.mktemp("pages"), tmp_path_factory.mktemp("trees")
    words = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-d",
        trees,
        "-D",
        "plot_gallery=0",
        DOCS,
        pages,
    ]
    environment = os.environ | {"MPLBACKEND": "Agg"}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return pages


@pytest.mark.slow
def test_no_link_is_broken_and_nothing_comes_from_outside(built: Path) -> None:
    pages = {file: Page(file) for file in built.rglob("*.html")}
    assert len(pages) >= 80
    broken, checked = [], 0
    for file, page in pages.items():
        for link in page.links + page.loads:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loads and parts.scheme != "data":
                    broken.append(f"{file.name} loads {link}")
                continue
            checked += 1
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not target.exists():
                broken.append(f"{file.name}: {link}")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].places:
                broken.append(f"{file.name}: {link}, no such place")
    assert not broken, broken[:20]
    assert checked > 1000


@pytest.mark.slow
def test_every_public_name_has_its_place_in_the_reference(built: Path) -> None:
    from docs.reference import public_names

    pages = {part: Page(built / "api" / f"{part}.html").places for part in public_names()}
    missing = [
        f"{part}.{name}"
        for part, names in public_names().items()
        for name in names
        if not name.startswith("__") and f"{part}.{name}" not in pages[part]
    ]
    assert not missing


def test_every_public_name_and_what_is_public_in_it_is_described() -> None:
    import importlib

    from docs.reference import public_names

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
    own = [page for page in pages if page.parts[0] not in {"figures", "index", "gallery", "api"}]
    assert len(own) >= 25
    assert all(f"\n{page}\n" in contents for page in own)
