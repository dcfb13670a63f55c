"""C++ text of the elementary functions of float32 lanes.

By way of float64: as many lanes of it, in `Wide`, so that a result is all but rounded once.
"""

_ONE = """
    exp exp2 expm1 log log2 log10 log1p sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh
    sigmoid erf erfc
"""
_TWO = "fmod remainder hypot atan2 pow"


def widening(lanes: int) -> str:
    """Every function that float32 lanes have no text of their own for."""
    if lanes == 1:
        casts = """
fn Wide::V widen(V a) { return (double)a; }
fn V narrow(Wide::V a) { return (float)a; }
"""
    else:
        casts = """
fn Wide::V widen(V a) { return __builtin_convertvector(a, Wide::V); }
fn V narrow(Wide::V a) { return __builtin_convertvector(a, V); }
"""
    one = [f"fn V {f}_(V x) {{ return narrow(Wide::{f}_(widen(x))); }}\n" for f in _ONE.split()]
    two = [
        f"fn V {f}_(V x, V y) {{ return narrow(Wide::{f}_(widen(x), widen(y))); }}\n"
        for f in _TWO.split()
    ]
    return casts + "".join(one + two)
