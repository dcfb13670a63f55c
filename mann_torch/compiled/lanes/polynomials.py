"""C++ text of polynomials in lane arithmetic."""

from collections.abc import Sequence


def polynomial(name: str, variable: str, coefficients: Sequence[float | str]) -> str:
    """Declare `V name`, the polynomial by Estrin's scheme, of ascending numbers or expressions.

    Pairs are joined as a tree, so the chain of dependent operations is short: a group of lanes
    seldom has other work to fill the gaps that Horner's scheme leaves.
    """
    lines: list[str] = []
    terms = [c if isinstance(c, str) else f"splat({c!r})" for c in coefficients]
    power = variable
    exponent = 1
    while len(terms) > 1:
        pairs = [f"fma({b}, {power}, {a})" for a, b in zip(terms[::2], terms[1::2], strict=False)]
        terms = pairs + terms[2 * len(pairs) :]
        if len(terms) > 1:
            exponent *= 2
            square = f"{name}_{exponent}"
            lines.append(f"V {square} = {power} * {power};")
            power = square
    lines.append(f"V {name} = {terms[0]};")
    return "\n  ".join(lines)
