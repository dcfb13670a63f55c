"""Equations as docstrings write them, `x_m' = A x_m + B r`, as LaTeX; None for what is none."""

from __future__ import annotations

import re
from collections.abc import Callable

_GREEK = {
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda",
    "mu", "nu", "xi", "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega", "Gamma",
    "Delta", "Theta", "Lambda", "Xi", "Pi", "Sigma", "Phi", "Psi", "Omega",
}  # fmt: skip
_NAMED = ("sin", "cos", "tan", "tanh", "exp", "log", "min", "max", "det", "sinh", "cosh")
_OPERATORS = {"sqrt": r"\sqrt", "sum": r"\sum"} | {
    name: rf"\operatorname{{{name}}}"
    for name in ("diag", "tr", "sat", "sign", "rank", "sigmoid", "softmax", "clamp", "adj")
}
_LETTERS = {f"d{letter}" for letter in "txesuayzqrvdWVMEPY"}
_RATES = {"qd": r"\dot{q} ", "qdd": r"\ddot{q} "}
_SIGNS = {
    "=": "=", "+": "+", "-": "-", "/": "/", "(": "(", ")": ")", ",": r",\;", "<": "<", ">": ">",
    ">=": r"\ge ", "<=": r"\le ", "|": "|", "'": "'", "[": "[", "]": "]", ";": r";\quad ",
    "->": r"\to ", "+-": r"\pm ", "!=": r"\ne ",
}  # fmt: skip
_TOKEN = re.compile(
    r"(?P<space>\s+)|(?P<number>\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
    r"|(?P<word>[A-Za-z]+\d*)|(?P<sub>_\{?\w+\}?|_(?=\())"
    r"|(?P<hat>\^(?![-+]?[\w(]|\+)|~(?!\w))|(?P<star>\*(?![\w(]))|(?P<power>\^-?(?:\d+|[A-Za-z]+))"
    r"|(?P<sign>>=|<=|->|\+-|!=|[-=+/(),<>|'\[\];])"
)


def _word(word: str) -> str | None:
    if word in _GREEK:
        return f"\\{word} "
    if word in _NAMED:
        return f"\\{word} "
    if word in _OPERATORS:
        return f"{_OPERATORS[word]} "
    base = re.fullmatch(r"([A-Za-z])(\d*)", word)
    if base:
        return f"{base[1]}_{{{base[2]}}}" if base[2] else f"{base[1]} "
    if word in _RATES:
        return _RATES[word]
    if word in _LETTERS:
        return f"{word[0]}{word[1]} "
    if word[0] == "d" and word[1:] in _GREEK:
        return f"d\\{word[1:]} "
    return None


def latex(text: str) -> str | None:
    """An equation or a row of them in LaTeX, if every sign of it is known."""
    text = text.strip().rstrip(".")
    if text.count("(") != text.count(")") or text.count("|") % 2 or "=" not in text:
        return None
    made: list[str] = []
    at = 0
    while at < len(text):
        token = _TOKEN.match(text, at)
        if token is None:
            return None
        at = token.end()
        kind, got = token.lastgroup, token[0]
        if kind == "space":
            continue
        if kind == "number":
            made.append(got + " ")
        elif kind == "word":
            word = _word(got)
            if word is None:
                return None
            made.append(word)
        elif kind == "sub":
            sub = got[1:].strip("{}")
            if not sub or not made:
                return None
            sub = f"\\{sub}" if sub in _GREEK else sub
            made.append(f"_{{{sub}}}")
        elif kind == "hat":
            # A hat or a tilde over the letter before it, its index kept beside.
            place = len(made) - 1
            while place >= 0 and made[place].startswith("_{"):
                place -= 1
            if place < 0 or not re.fullmatch(r"[A-Za-z] |\\[A-Za-z]+ ", made[place]):
                return None
            over = "hat" if got == "^" else "tilde"
            made[place] = f"\\{over}{{{made[place].strip()}}}"
        elif kind == "star":
            made.append("^{*}")
        elif kind == "power":
            power = got[1:]
            name = power.lstrip("-")
            if name in _GREEK:
                power = power.replace(name, f"\\{name}")
            elif name.isalpha() and len(name) > 1:
                return None
            made.append(f"^{{{power}}}")
        else:
            made.append(_SIGNS[got])
    whole = re.sub(r"\\sqrt \(([^()]*)\)", r"\\sqrt{\1}", "".join(made))
    return None if r"\sqrt (" in whole else whole.strip()


#: Where an equation may begin in a sentence, and what may follow it.
_BEFORE = re.compile(
    r"(?:^|(?<=[.;:,(]\s)|(?<=\()|(?<=\b(?:with|that|when)\s)|(?<=\bwhere\s))(?=[\w|-])"
)
_AFTER = re.compile(
    r"\s*$|[.;:,)](?:\s|$|[.;,])|\s+(?:with|where|and|for|which|is|if|or|has)\b"
    r"|\s+\((?:an?|the|see|paper|eqs?|[a-z]{5,})\b"
)


def _end(text: str, start: int) -> int:
    """Where the longest equation ends that begins here; `start` if there is none."""
    at, end, depth = start, start, 0
    while token := _TOKEN.match(text, at):
        if token["word"] and _word(token[0]) is None:
            break
        depth += (token[0] == "(") - (token[0] == ")")
        if depth < 0:
            break
        at = token.end()
        if not depth and token[0].strip(" ,;") and _AFTER.match(text, at):
            found = text[start:at]
            if re.search(r"\s[=<>]=?\s", found) and latex(found.replace("\n", " ")):
                end = at
    return end


def with_equations(text: str, escaped: Callable[[str], str]) -> str:
    """A piece of prose with the equations in it set."""
    made, at = [], 0
    for start in (found.start() for found in _BEFORE.finditer(text)):
        if start < at or (end := _end(text, start)) == start:
            continue
        made.append(escaped(text[at:start]))
        made.append(f"\\ :math:`{latex(text[start:end].replace(chr(10), ' '))}`\\ ")
        at = end
    return "".join([*made, escaped(text[at:])])
