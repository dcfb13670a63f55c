"""A C99 file: what it needs of the compiler, the library's functions, and the steps."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..cpp.expressions import number, whole
from ..real import DOUBLE, FLOAT, Real
from .library import WHOLE, called, calls, library, named
from .machine import FUSED
from .unit import CUnit

# gcc knows no standard pragma for contraction; in its ISO modes it contracts nothing.
_HEAD = """#include <stdbool.h>
#include <stdint.h>
@MATH@
#if defined(__FAST_MATH__)
#error "-ffast-math changes what is computed: leave it out"
#endif
#if defined(__FLT_EVAL_METHOD__) && (__FLT_EVAL_METHOD__ == 1 || __FLT_EVAL_METHOD__ == 2)
#error "numbers are kept in more bits than they have: on x86 compile with -msse2 -mfpmath=sse"
#endif
// No product and sum are joined but by fma.
#if defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#elif !defined(__STRICT_ANSI__)
#pragma GCC optimize("fp-contract=off")
#endif
"""
# Where the machine has no fma, sums of a step are a * b + c, rounded twice; only in the elementary
# functions, where the product's error matters, it is computed.
_FMA = """#if defined(FP_FAST_FMA@F@) || defined(__FP_FAST_FMA@F@) || defined(__FMA__) || \\
    (defined(__ARM_FEATURE_FMA)@ARM@)
#define @NAME@ 1
#endif
"""


def c99_file(units: Sequence[CUnit], prefix: str, libm: bool = True) -> str:
    """The functions with all that they call, named with a prefix: the file's own come after.

    In a file of float32, functions in float64 call what float32's are made of. With `libm`
    <math.h> gives square roots, rounding, fma, and sin, cos, tan beyond 1e9 and fmod beyond
    quotients of 2^52; without, those beyond are NaN, and nothing is linked.
    """
    real = FLOAT if any(unit.real is FLOAT for unit in units) else DOUBLE
    own = [called(unit.text, unit.real, real) for unit in units]
    text = library(calls("\n".join(own), real), real, libm, prefix)
    head = _HEAD.replace("@MATH@", "#include <math.h>" if libm else "")
    parts = [head, _macros(text, prefix), text, "", *(named(t, real, prefix) for t in own)]
    return "\n".join(parts) + "\n"


def _macros(text: str, prefix: str) -> str:
    """Those that a text asks for."""
    found = []
    for size, macro in FUSED.items():
        name = prefix.upper() + macro
        if f"({name})" in text:
            suffix = macro.removeprefix("HAVE_FMA")
            arm = " && (!defined(__ARM_FP) || (__ARM_FP & 8))" if size == 8 else ""
            made = _FMA.replace("@F@", suffix).replace("@ARM@", arm)
            found.append(made.replace("@NAME@", name))
    return "".join(found)


def c99_literals(name: str, values: Tensor, real: Real) -> str:
    """An array of a file: floating numbers exactly, or integers."""
    if values.is_floating_point():
        return _array(real.name, name, [number(repr(v), real) for v in values.tolist()])
    return _array(WHOLE[real.bytes], name, [whole(str(v)) for v in values.tolist()])


def _array(kind: str, name: str, values: Sequence[str]) -> str:
    lines = ",\n".join("  " + ", ".join(values[i : i + 4]) for i in range(0, len(values), 4))
    return f"static const {kind} {name}[{max(len(values), 1)}] = {{\n{lines or '  0'}\n}};\n"
