"""The site builds without a warning, and everything it links to is there."""

from __future__ import annotations

import html
import importlib
import inspect
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import matplotlib
import pytest

import mann_torch as mt
from tests.site.pages import DOCS, OUTSIDE, ROOT, blocks_of, pages

OUT = DOCS / "_build" / "check"
#: Not what the tests are about: cells and the gallery are run by `make docs`.
QUICK = ("-D", "nb_execution_mode=off", "-D", "plot_gallery=False")
#: A third of the build would be the contents beside each page, with every name of the reference.
QUICK += ("-D", "toc_object_entries=0")


#: A link whose text is the name of a page's file.
_FILE_SHOWN = re.compile(r"<a [^>]*href=[^>]*>(?:<[^>]*>)*([\w/.]+\.md)<")


class Page(HTMLParser):
    """The anchors of a page, and what it links to and loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take a tag's addresses."""
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") == "stylesheet":
            self.loaded.append(given["href"])
        elif tag in ("script", "img", "iframe", "source", "video") and "src" in given:
            self.loaded.append(given["src"])


def test_the_site_builds_without_a_warning_and_its_links_resolve() -> None:
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-E",
        "-W",
        "--keep-going",
        "-b",
        "html",
        *QUICK,
    ]
    built = subprocess.run([*command, DOCS, OUT], cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    found = {path: Page(path) for path in OUT.rglob("*.html") if "_static" not in path.parts}
    assert len(found) > len(list(DOCS.glob("*.md")))
    wrong = [f"{path.relative_to(OUT)}: {what}" for path in found for what in broken(path, found)]
    assert not wrong, "\n".join(wrong)
    files = {name for path in found for name in _FILE_SHOWN.findall(path.read_text())}
    assert not files, f"links show {files}, not titles"
    check_reference()
    check_signatures()
    check_names()
    check_search()


def broken(path: Path, found: dict[Path, Page]) -> list[str]:
    """Links and anchors of a page that lead nowhere, and what it would load from elsewhere."""
    page, wrong = found[path], []
    for address in page.loaded:
        local = (path.parent / unquote(address.partition("?")[0])).resolve()
        if re.match(r"(https?:)?//", address) or not local.exists():
            wrong.append(f"loads {address}")
    for address in page.links:
        if re.match(r"(https?|mailto):", address):
            continue
        place, _, anchor = unquote(address).partition("#")
        target = (path.parent / place.partition("?")[0]).resolve() if place else path
        if not target.exists():
            wrong.append(f"links to {address}")
        elif anchor and target in found and anchor not in found[target].anchors:
            wrong.append(f"links to {address}, which has no such anchor")
    return wrong


def check_reference() -> None:
    """Every public name has its place, with what its docstring says."""
    index = Page(OUT / "api" / "index.html")
    linked = {link.partition("#")[2].rpartition(".")[2] for link in index.links if "#" in link}
    assert set(mt.__all__) <= linked
    text = (OUT / "api" / "mann_torch.simulation.html").read_text()
    shown = " ".join(html.unescape(re.sub(r"<[^>]+>", "", text)).split())
    assert "Integrate the loop over the scenario and record it." in shown
    packages = ("control", "memory", "plants", "signals", "parts", "simulation", "tuning")
    for package in (*packages, "testing", "deployment", "simulators"):
        names = getattr(mt, package).__all__
        page = Page(OUT / "api" / f"mann_torch.{package}.html")
        places = page.anchors | {link.partition("#")[2] for link in page.links}
        ends = {place.rpartition(".")[2] for place in places}
        assert set(names) <= ends, set(names) - ends


def check_signatures() -> None:
    """A class is shown with the arguments that its `__init__` takes, a protocol with none."""
    entry = re.compile(r'<dt class="sig sig-object py" id="([\w.]+)">(.*?)</dt>', re.S)
    argument = re.compile(r'class="sig-param">.*?<span class="n"><span class="pre">(\w+)', re.S)
    seen = 0
    for path in (OUT / "api").glob("mann_torch*.html"):
        package = importlib.import_module(path.stem)
        for place, shown in entry.findall(path.read_text()):
            thing = getattr(package, place.removeprefix(f"{path.stem}."), None)
            if not isinstance(thing, type) or issubclass(thing, Exception):
                continue
            assert argument.findall(shown) == taken_by(thing), place
            seen += 1
    assert seen > 100


def taken_by(thing: type) -> list[str]:
    """Names of a class's arguments."""
    if issubclass(thing, tuple):  # a NamedTuple has no `__init__`
        return list(inspect.signature(thing).parameters)
    init = thing.__init__  # type: ignore[misc]
    if not str(getattr(init, "__module__", "")).startswith("mann_torch"):
        return []
    return list(inspect.signature(init).parameters)[1:]


def check_names() -> None:
    """A page's names of classes lead to where they are imported from; an attribute's don't."""
    linked = {link.rpartition("#")[2] for link in Page(OUT / "choosing.html").links}
    kinds = [*mt.control.CONTROLLERS.values(), *mt.control.LAW_PARTS.values()]
    names = {kind.__name__ for kind in kinds} - {"ConstantGain"}
    assert {f"mann_torch.control.{name}" for name in names} <= linked
    linked = {link.rpartition("#")[2] for link in Page(OUT / "compiling.html").links}
    assert "mann_torch.metrics.switches" not in linked  # there, an attention's


def check_search() -> None:
    """The index is a script that a page loads from disk, and it knows the pages."""
    text = (OUT / "searchindex.js").read_text()
    index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    assert "memory" in index["docnames"] and "api/mann_torch.control" in index["docnames"]
    assert {"rollout", "quadrotor"} <= set(index["terms"]) | set(index["titleterms"])


def test_no_page_is_outside_the_contents() -> None:
    listed = set()
    for path in pages().values():
        for block in re.findall(r"```\{toctree\}\n(.*?)```", path.read_text(), re.S):
            rows = [row.strip() for row in block.splitlines()]
            listed |= {row for row in rows if row and not row.startswith(":")}
    written = {name.removesuffix(".md") for name in pages() if name not in OUTSIDE}
    made = {"api/index", "auto_gallery/index"}  # by the build
    assert written - listed == {"index"} and made <= listed
    assert all((DOCS / f"{name}.md").exists() for name in listed - made)


def test_the_repositorys_own_pages_link_to_what_is_there() -> None:
    for name in OUTSIDE:
        if not (ROOT / name).exists():
            continue
        text = re.sub(r"```.*?```", "", (ROOT / name).read_text(), flags=re.S)
        for place, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)(#[^)\s]+)?\)", text):
            target = ROOT / (place or name)
            assert target.exists(), f"{name} links to {place}"
            if anchor:
                heads = re.findall(r"^#+ (.*)$", target.read_text(), re.M)
                slugs = {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}
                assert anchor[1:] in slugs, f"{name} links to {place}{anchor}"


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(
        '<a id="there"></a><a href="#there">1</a><a href="#nowhere">2</a><a href="no.html">3</a>'
        '<script src="https://elsewhere/mathjax.js"></script>'
    )
    assert len(broken(page, {page: Page(page)})) == 3


def test_the_first_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    with matplotlib.rc_context({"backend": "agg"}):
        for block in blocks_of("index.md", DOCS / "index.md"):
            if block.language.startswith("{code-cell}"):
                exec(re.sub(r"\A(:.*\n)+", "", block.body), names)
    assert "d SRMSE / d Lambda" in capsys.readouterr().out
