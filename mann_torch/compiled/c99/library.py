"""The lanes' library as C99 functions, of which only those that are called are written."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Mapping

from ..lanes.library import DOUBLES, single_functions
from ..lanes.linear import LINEAR
from ..lanes.types import CHOICES, SCALAR, narrowed
from ..real import DOUBLE, Real
from .machine import machine

_HEAD = re.compile(r"^(?:fn|slow) [\w:* ]+ (\w+)\(")
_CALL = re.compile(r"(?<![\w:.>])((?:Wide::)?[A-Za-z_]\w*)(?=\()")
# A number spread over one lane is itself; without a suffix it is one of float64.
_SPLAT = {
    8: re.compile(r"\bsplat\((-?)(\w[\w.]*(?:(?<=[ep])[+-]\d+)?)\)"),
    4: re.compile(r"\bsplat\((-?)(\w[\w.]*(?:(?<=p)[+-]\d+)?f)\)"),
}
#: The integers of a number's bits.
WHOLE = {8: "int64_t", 4: "int32_t"}


@functools.cache
def functions(real: Real, libm: bool) -> Mapping[str, str]:
    """Name -> text, with the comment above it; float64's as `Wide::name` beside float32's."""
    narrow, own = machine(real, libm)
    if real is DOUBLE:
        return _split(_typed(SCALAR + narrow + own + CHOICES + DOUBLES + LINEAR, real))
    wide = functions(DOUBLE, libm)
    found = {
        f"Wide::{name}": _CALL.sub(lambda m: _wide(m, wide), text) for name, text in wide.items()
    }
    text = narrowed(SCALAR + narrow + CHOICES) + own + single_functions(1) + LINEAR
    return {**found, **_split(_typed(text, real))}


def _wide(call: re.Match[str], wide: Mapping[str, str]) -> str:
    name = call.group(1)
    return f"Wide::{name}" if name in wide else name


def _split(text: str) -> dict[str, str]:
    """Functions by name, as they stand one after the other."""
    found: dict[str, str] = {}
    above: list[str] = []
    lines = iter(text.replace("@LANES@", "1").splitlines())
    for line in lines:
        head = _HEAD.match(line)
        if head is None:
            above = [*above, line] if line.startswith("//") else []
            continue
        body = [line]
        while not body[-1].startswith("}") and not (len(body) == 1 and line.endswith("}")):
            body.append(next(lines))
        found[head.group(1)] = "\n".join([*above, *body])
        above = []
    return found


def _typed(text: str, real: Real) -> str:
    """With the names that C has for numbers."""
    whole = WHOLE[real.bytes]
    text = re.sub(r"Wide::V\b", "double", text)
    text = text.replace("unsigned long long", f"u{whole}").replace("unsigned int", f"u{whole}")
    text = text.replace("long long", whole)
    text = _SPLAT[real.bytes].sub(lambda m: f"(-{m[2]})" if m[1] else m[2], text)
    return re.sub(r"\bV\b", real.name, re.sub(r"\bM\b", whole, text))


def called(text: str, own: Real, real: Real) -> str:
    """Text in one arithmetic with C's types, its calls those of a file in another, or the same."""
    known = functions(own, True)
    wide = "" if own is real else "Wide::"
    return _CALL.sub(
        lambda m: wide + m.group(1) if m.group(1) in known else m.group(1), _typed(text, own)
    )


def calls(text: str, real: Real) -> frozenset[str]:
    """The library's functions that a text calls."""
    known = functions(real, True)
    return frozenset(name for name in _CALL.findall(text) if name in known)


def named(text: str, real: Real, prefix: str) -> str:
    """Text of a function, with the names that what it calls of the library has in a file."""
    known = functions(real, True)

    def call(found: re.Match[str]) -> str:
        name = found.group(1)
        return prefix + name.replace("Wide::", "wide_") if name in known else name

    text = _CALL.sub(call, text).replace("libm::", "")
    return re.sub(r"\bHAVE_FMA(F?)\b", rf"{prefix.upper()}HAVE_FMA\1", text)


def library(used: Iterable[str], real: Real, libm: bool, prefix: str) -> str:
    """Text of the functions that are called, each after those that it calls itself."""
    known = functions(real, libm)
    order: dict[str, None] = {}

    def write(name: str) -> None:
        for other in _CALL.findall(known[name]):
            if other in known and other != name and other not in order:
                write(other)
        order[name] = None

    for name in sorted(used):
        if name not in order:
            write(name)
    return "\n".join(_static(named(known[name], real, prefix)) for name in order)


def _static(text: str) -> str:
    return re.sub(r"^(fn|slow) ", "static inline ", text, flags=re.MULTILINE)
