"""Text of elementary functions on lanes, written once for one lane, for several, and for C99.

`lane_library` is pasted into a function body inside `struct Lanes { ... };`, after `lane_types`.
Every function is branch-free but for rare ranges that no short reduction covers, so a result's bits
depend neither on the number of lanes nor on the other lanes. Errors are measured by
`tests/compiled/test_lane_maths.py`.
"""

import re

from ..real import DOUBLE, Real
from .exponentials import EXPONENTIALS
from .logarithms import LOGARITHMS
from .singles import singles, wide_lanes
from .special import SPECIAL
from .trigonometry import TRIGONOMETRY
from .types import check_lanes, lane_types, narrowed, primitives

__all__ = ["lane_library", "lane_types"]

# Contraction would make the bits depend on what the compiler fuses.
_PRAGMA = """
#if defined(__clang__)
#pragma clang fp contract(off)
#endif
"""


def lane_library(lanes: int, qualifier: str = "", real: Real = DOUBLE) -> str:
    """The body of `struct Lanes`; `qualifier` stands before each function."""
    check_lanes(lanes)
    if real is DOUBLE:
        return qualified(primitives(lanes) + _FAR + DOUBLES, lanes, qualifier)
    half = wide_lanes(lanes)
    wide = f"struct Wide {{\n{lane_types(half)}{lane_library(half, qualifier)}}};\n"
    return wide + qualified(primitives(lanes, real) + single_functions(lanes), lanes, qualifier)


def single_functions(lanes: int) -> str:
    """What stands on the primitives of float32, and on `Wide`."""
    return narrowed(_BASIC) + singles(lanes)


def qualified(text: str, lanes: int, qualifier: str) -> str:
    """Text of functions with what stands before them and in them in C++."""
    text = text.replace("@LANES@", str(lanes))
    prefix = f"{qualifier} static inline".strip()
    # A rare path inlined would spill registers in the common one.
    cold = f"__attribute__((noinline)) {prefix}" if lanes > 1 else prefix
    for word, start in (("fn", prefix), ("slow", cold)):
        text = re.sub(rf"^{word} (.*?\)) \{{", rf"{start} \1 {{{_PRAGMA}", text, flags=re.MULTILINE)
    return text


_BASIC = """
fn V abs_(V x) { return from_bits(bits(x) & 0x7fffffffffffffffLL); }
fn M sign_bit(V x) { return bits(x) & (-0x7fffffffffffffffLL - 1); }
fn V copysign_(V x, V s) { return from_bits((bits(x) & 0x7fffffffffffffffLL) | sign_bit(s)); }
fn V sign_(V x) {
  return mask_to_double(gt(x, splat(0.0))) - mask_to_double(lt(x, splat(0.0)));
}
fn V max_(V a, V b) { return sel(mor(gt(a, b), ne(a, a)), a, b); }
fn V min_(V a, V b) { return sel(mor(lt(a, b), ne(a, a)), a, b); }
fn M imax(M a, M b) { return isel(igt(a, b), a, b); }
fn M imin(M a, M b) { return isel(ilt(a, b), a, b); }
// Zero divides like one, as C++ has no answer; nor has it for the smallest integer by -1.
fn M idiv(M a, M b) {
  M plain = mor(ieq(b, isplat(0)), ieq(b, isplat(-1)));
  M d = isel(plain, isplat(1), b);
  M q = a / d;
  M r = a - q * d;
  q += mand(ine(r, isplat(0)), ilt(r ^ d, isplat(0)));
  return isel(ieq(b, isplat(-1)), isub(isplat(0), a), q);
}
fn M imod(M a, M b) {
  M d = isel(mor(ieq(b, isplat(0)), ieq(b, isplat(-1))), isplat(1), b);
  M r = a - (a / d) * d;
  return r + mand(d, mand(ine(r, isplat(0)), ilt(r ^ d, isplat(0))));
}
// The power -n is the reciprocal, 0 where x^n overflows.
fn V powi(V x, int n) {
  unsigned m = n < 0 ? 0u - (unsigned)n : (unsigned)n;
  V r = splat(1.0);
  V s = x;
  bool first = true;
  while (m != 0) {
    if (m & 1u) {
      r = first ? s : r * s;
      first = false;
    }
    m >>= 1;
    if (m != 0) s = s * s;
  }
  return n < 0 ? splat(1.0) / r : r;
}
"""
_MORE = """
slow V fmod_far(V x, V y, M far, V r) {
  for (int i = 0; i < @LANES@; ++i) {
    if (iget(far, i) != 0) put(&r, i, far_fmod(get(x, i), get(y, i)));
  }
  return r;
}
// A rounded quotient below 2^52 is at most one too high, and the remainder of it is exact.
fn V fmod_(V x, V y) {
  V a = abs_(x);
  V b = abs_(y);
  V quotient = a / b;
  V r = fused(-trunc_(quotient), b, a);
  r = sel(lt(r, splat(0.0)), r + b, r);
  r = copysign_(sel(lt(a, b), a, r), x);
  M far = mnot(lt(quotient, splat(4503599627370496.0)));
  return any(far) ? fmod_far(x, y, far, r) : r;
}
fn V remainder_(V x, V y) {
  V r = fmod_(x, y);
  M wrong = mand(ne(r, splat(0.0)), mxor(lt(y, splat(0.0)), lt(r, splat(0.0))));
  return sel(wrong, r + y, r);
}
fn V hypot_(V x, V y) {
  V a = abs_(x);
  V b = abs_(y);
  V big = sel(gt(a, b), a, b);
  V small = sel(gt(a, b), b, a);
  M high = gt(big, splat(0x1p500));
  M low = lt(big, splat(0x1p-400));
  V scale = sel(high, splat(0x1p-600), sel(low, splat(0x1p700), splat(1.0)));
  V back = sel(high, splat(0x1p600), sel(low, splat(0x1p-700), splat(1.0)));
  big = big * scale;
  small = small * scale;
  V r = sqrt_(fma(big, big, small * small)) * back;
  V infinity = inf_();
  return sel(mor(eq(a, infinity), eq(b, infinity)), infinity, r);
}
"""

# The C library reduces what no short reduction covers.
_FAR = """
fn double far_sin(double x) { return ::sin(x); }
fn double far_cos(double x) { return ::cos(x); }
fn double far_tan(double x) { return ::tan(x); }
fn double far_fmod(double x, double y) { return ::fmod(x, y); }
"""

#: What stands on the primitives of float64.
DOUBLES = _BASIC + _MORE + EXPONENTIALS + LOGARITHMS + TRIGONOMETRY + SPECIAL
