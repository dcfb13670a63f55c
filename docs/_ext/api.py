"""The API reference: a page a package, written from its public names and their docstrings."""

from __future__ import annotations

import inspect
import re
from abc import ABCMeta
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

from fields import fields_of, shown_fields
from prose import inline, restructured
from public import PACKAGES, Public, comment_of, everything, homes, members_of
from signatures import inherited_from, process_signature, shown_attribute
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

import mann_torch
from mann_torch.registry import Registry

_NAMES = everything()
_HOMES = homes(_NAMES)
#: Full name of every documented object, by each name it may be called.
_PLACES: dict[str, str] = {}
for _public in _NAMES:
    _home = _HOMES[id(_public.thing)] if _public.kind != "data" else _public
    for _called in (_public.place, f"{_public.package.removeprefix('mann_torch.')}.{_public.name}"):
        _PLACES[_called] = _home.place
    _PLACES.setdefault(_public.name, _home.place)
for _name in mann_torch.__all__:
    _PLACES[f"mann_torch.{_name}"] = _PLACES[f"mt.{_name}"] = _PLACES[_name]
#: Other people's names that docstrings mention, shortened or not.
_OTHERS = {"nn.": "torch.nn.", "torch.": "torch.", "np.": "numpy.", "numpy.": "numpy."}


#: Aliases and type variables that annotations name and nobody documents.
_ALIASES = {"ControllerTree", "Mode", "Parameters"}


def _members(thing: type) -> set[str]:
    """Names that autodoc shows of a class, and its fields."""
    kinds = (property, classmethod, staticmethod)
    own = {n for n, v in vars(thing).items() if inspect.isfunction(v) or isinstance(v, kinds)}
    commented = ModuleAnalyzer.for_module(thing.__module__).find_attr_docs()
    own |= {name for owner, name in commented if owner == thing.__qualname__}
    return {name for name in own if name[0] != "_"} | set(fields_of(thing))


def resolver(known: set[str], within: Public | None) -> Any:
    """What a name in backticks links to, in the docstring of a public object."""

    def resolve(code: str) -> str | None:
        name = re.sub(r"\(.*\)$", "", code, flags=re.S).strip()
        if not re.fullmatch(r"[\w.]+", name):
            return None
        if name in _PLACES:
            return _PLACES[name]
        owner, _, member = name.rpartition(".")
        if owner in _PLACES:
            thing = next((p.thing for p in _NAMES if p.place == _PLACES[owner]), None)
            if isinstance(thing, type) and member in _members(thing):
                return f"{_PLACES[owner]}.{member}"
        if within is not None and isinstance(within.thing, type) and name in _members(within.thing):
            return f"{within.place}.{name}"
        for short, full in _OTHERS.items():
            if name.startswith(short) and full + name.removeprefix(short) in known:
                return full + name.removeprefix(short)
        return None

    return resolve


def _summary(public: Public) -> str:
    """The first sentence of what it says of itself."""
    if public.kind == "data":
        text = " ".join(comment_of(public.package, public.name))
        if isinstance(public.thing, Registry):
            return text or f"Every {public.thing.what} by its name in configurations."
        if isinstance(public.thing, tuple) and not text:
            return ", ".join(f"``{value}``" for value in public.thing) + "."
        text = text or f"``{public.thing!r}``"
    else:
        text = inspect.getdoc(public.thing) or ""
    first = text.split("\n\n")[0].replace("\n", " ")
    first = re.split(r"(?<=[\w)`\]'])(?<!eq)(?<!eqs)\.(?: |$)", first)[0]
    if len(first) > 140:
        first = re.split(r"[:;] ", first)[0]
    return first.rstrip(":") + "."


def _rows(names: Iterable[Public], known: set[str]) -> list[str]:
    made = [".. list-table::", "   :widths: 30 70", "   :class: names", ""]
    for public in names:
        home = _HOMES[id(public.thing)] if public.kind != "data" else public
        made.append(f"   * - :py:obj:`{public.name} <{home.place}>`")
        told = inline(_summary(public), resolver(known, home)).replace("\n", " ")
        made.append(f"     - {told}")
    return [*made, ""]


def _headed(text: str, line: str) -> list[str]:
    return [text, line * len(text), ""]


def page(package: str, known: set[str]) -> str:
    """The text of a package's page."""
    names = [p for p in _NAMES if p.package == package]
    own = [p for p in names if p.kind == "data" or _HOMES[id(p.thing)] is p]
    lines = [*_headed(package, "="), f".. py:module:: {package}", ""]
    told = inspect.cleandoc(import_module(package).__doc__ or "").split("\n")
    lines += restructured(told, resolver(known, None))
    rooms = sorted({p.room for p in own} - {""})
    rooms = [r for r in rooms if inspect.ismodule(getattr(import_module(package), r, None))]
    rooms = [r for r in rooms if hasattr(getattr(import_module(package), r), "__path__")]
    groups = [("", [p for p in own if p.room not in rooms])]
    groups += [(room, [p for p in own if p.room == room]) for room in rooms]
    others = [p for p in names if p not in own]
    lines += _rows([p for _, group in groups for p in group] + others, known)
    for room, group in groups:
        if room and group:
            lines += _headed(room.replace("_", " ").capitalize(), "-")
            doc = inspect.cleandoc(getattr(import_module(package), room).__doc__ or "")
            lines += restructured(doc.split("\n"), resolver(known, None))
        for public in group:
            lines.append(f".. auto{public.kind}:: {public.place}")
            if public.kind == "class":
                lines.append("   :members:")
                if others := inherited_from(public.thing, _HOMES):
                    lines.append(f"   :inherited-members: {others}")
            elif public.kind == "data" and len(repr(public.thing)) > 90:
                lines.append("   :no-value:")
            lines.append("")
    return "\n".join(lines)


def _index(known: set[str]) -> str:
    lines = [
        *_headed("API reference", "="),
        "What `mann_torch` exports by itself:".replace("`", "``"),
    ]
    lines += ["", *_rows([_public_of(n) for n in mann_torch.__all__], known)]
    lines += ["Everything, by package:", "", ".. toctree::", "   :maxdepth: 1", ""]
    lines += [f"   {package} <{package}>" for package in PACKAGES]
    lines += ["", ".. list-table::", "   :widths: 30 70", "   :class: names", ""]
    for package, what in PACKAGES.items():
        lines += [f"   * - :doc:`{package}`", f"     - {what}"]
    return "\n".join([*lines, ""])


def _public_of(name: str) -> Public:
    thing = getattr(mann_torch, name)
    return next(p for p in _NAMES if p.thing is thing)


def write_pages(app: Sphinx) -> None:
    """Write docs/api/, all of it; a page that stays as it was is not touched."""
    known = _known_elsewhere(app)
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    texts = {f"{package}.rst": page(package, known) for package in PACKAGES}
    texts["index.rst"] = _index(known)
    for old in folder.glob("*.rst"):
        if old.name not in texts:
            old.unlink()
    for name, text in texts.items():
        path = folder / name
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def _known_elsewhere(app: Sphinx) -> set[str]:
    return set(app.config.foreign_names)


def process_docstring(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    """Plain text becomes reStructuredText; constants and fields say what they hold."""
    owner = next((p for p in _NAMES if name == p.place or name.startswith(f"{p.place}.")), None)
    resolve = resolver(_known_elsewhere(app), owner)
    if what == "data" and owner is not None:
        text = comment_of(owner.package, owner.name)
        if isinstance(thing, Registry):
            text = text or [_summary(owner)]
            text += ["", *(f"- ``{key}``: `{kind.__name__}`" for key, kind in members_of(thing))]
        lines[:] = restructured(text, resolve)
        return
    if lines and re.match(r"\w+\(.*\)$", lines[0]) and what == "class":
        lines[:] = []  # a dataclass's made-up docstring: its signature
    lines[:] = restructured(list(lines), resolve)
    if what in ("class", "exception"):
        lines += shown_fields(thing, resolve)


def skip_member(
    app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any
) -> bool | None:
    """Fields are shown with their comments, not as autodoc has them."""
    if isinstance(thing, type):
        return True  # which of its public classes a class uses
    return True if str(thing.__doc__).startswith("Alias for field number") else None


def missing_reference(app: Sphinx, env: Any, node: pending_xref, content: Any) -> Any:
    """A name by its submodule, or as annotations shorten it: its one place."""
    if node.get("refdomain") != "py":
        return None
    target = str(node.get("reftarget", ""))
    place = _PLACES.get(target) or _PLACES.get(target.rsplit(".", 1)[-1])
    if place is None:
        # A type of the library's own, or an alias of its types: annotations name it, no page does.
        own = target.startswith("mann_torch.") or target in _ALIASES
        shown = str(node["refdoc"]).startswith("api/") and node.get("reftype") == "class"
        return content if own and shown else None
    if place == target:
        return None
    domain = env.domains.python_domain
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", place, node, content)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect it all."""
    app.add_config_value("foreign_names", [], "")
    app.add_autodoc_attrgetter(ABCMeta, shown_attribute)
    app.connect("builder-inited", write_pages)
    app.connect("autodoc-process-docstring", process_docstring)
    app.connect("autodoc-process-signature", process_signature)
    app.connect("autodoc-skip-member", skip_member)
    app.connect("missing-reference", missing_reference)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
