"""What the lanes' library calls a machine's operations, in C99: one lane, of float64.

`libm::` marks a function of <math.h>. Text without it needs no library: a square root by Newton's
method, rounded correctly by its exact remainder, and integers for what rounds.
"""

from __future__ import annotations

from ..real import DOUBLE, Real

_BITS = """
fn M bits(V a) { union { V number; M whole; } u; u.number = a; return u.whole; }
fn V from_bits(M a) { union { V number; M whole; } u; u.whole = a; return u.number; }
fn V mul(V a, V b) { return a * b; }
"""
# The branches call no function of the library, which the other would leave unused.
# Veltkamp's split and Dekker's product, Knuth's sum: the error beside the product and the sum.
_FUSED = """
// a b + c, rounded once where the machine can.
fn V fma(V a, V b, V c) {
#if defined(@FUSED@)
  return @FMA@(a, b, c);
#else
  return a * b + c;
#endif
}
// a b + c of the exact product.
fn V fused(V a, V b, V c) {
#if defined(@FUSED@)
  return @FMA@(a, b, c);
#else
  V back = 1.0;
  if (a > 0x1p990 || a < -0x1p990) { a = a * 0x1p-60; c = c * 0x1p-60; back = 0x1p60; }
  else if (b > 0x1p990 || b < -0x1p990) { b = b * 0x1p-60; c = c * 0x1p-60; back = 0x1p60; }
  V product = a * b;
  V a_high = a * 134217729.0, b_high = b * 134217729.0;
  a_high = a_high - (a_high - a);
  b_high = b_high - (b_high - b);
  V a_low = a - a_high, b_low = b - b_high;
  V rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low;
  V sum = product + c;
  V shift = sum - product;
  V lost = (product - (sum - shift)) + (c - shift);
  return (sum + (lost + rest)) * back;
#endif
}
"""
_FUSED_SINGLE = """
// a b + c, rounded once where the machine can.
fn V fma(V a, V b, V c) {
#if defined(@FUSED@)
  return @FMA@(a, b, c);
#else
  return a * b + c;
#endif
}
// a b + c of the exact product.
fn V fused(V a, V b, V c) {
#if defined(@FUSED@)
  return @FMA@(a, b, c);
#else
  return (V)((double)a * (double)b + (double)c);
#endif
}
"""
_LIBM = """
fn V sqrt_(V a) { return libm::sqrt@F@(a); }
fn V floor_(V a) { return libm::floor@F@(a); }
fn V ceil_(V a) { return libm::ceil@F@(a); }
fn V trunc_(V a) { return libm::trunc@F@(a); }
fn V round_(V a) { return libm::rint@F@(a); }
"""
_FAR_LIBM = """
fn double far_sin(double x) { return libm::sin(x); }
fn double far_cos(double x) { return libm::cos(x); }
fn double far_tan(double x) { return libm::tan(x); }
fn double far_fmod(double x, double y) { return libm::fmod(x, y); }
"""
_NO_FAR = """
// Without <math.h> there is no answer beyond the range of the short reduction.
fn double far_sin(double x) { (void)x; return nan_(); }
fn double far_cos(double x) { (void)x; return nan_(); }
fn double far_tan(double x) { (void)x; return nan_(); }
fn double far_fmod(double x, double y) { (void)x; (void)y; return nan_(); }
"""
# From 2^52 on every number is whole.
_ROUNDING = """
fn V trunc_(V a) {
  return abs_(a) < 4503599627370496.0 ? copysign_(to_double(to_int_raw(a)), a) : a;
}
fn V floor_(V a) {
  V t = trunc_(a);
  return t > a ? t - splat(1.0) : t;
}
fn V ceil_(V a) {
  V t = trunc_(a);
  return t < a ? t + splat(1.0) : t;
}
fn V round_(V a) {
  V limit = splat(4503599627370496.0);
  return abs_(a) < limit ? copysign_((abs_(a) + limit) - limit, a) : a;
}
"""
# m = x / 4^half lies from 1 to 4, its root s from 1 to 2: a unit in the last place of s is 2^-52.
_ROOT = """
fn V sqrt_(V x) {
  if (!(x > 0.0)) return x == 0.0 ? x : nan_();
  if (x == inf_()) return x;
  V back = 1.0;
  if (x < 0x1p-1022) { x = x * 0x1p54; back = 0x1p-27; }
  M half = ((bits(x) >> 52) - 1023) >> 1;
  V m = from_bits(isub(bits(x), shl(2 * half, 52)));
  V s = from_bits(0x1ff7a3bea91d9b1bLL + (bits(m) >> 1));
  for (int i = 0; i < 4; ++i) s = 0.5 * (s + m / s);
  V rest = fused(-s, s, m);
  V unit = s * 0x1p-52;
  s = rest > unit ? s + 0x1p-52 : rest <= -unit ? s - 0x1p-52 : s;
  return from_bits(bits(s) + shl(half, 52)) * back;
}
"""
_ROOT_SINGLE = """
fn V sqrt_(V a) { return narrow(Wide::sqrt_(widen(a))); }
"""

#: Defined where the machine rounds a product and a sum once, by bytes of a number.
FUSED = {8: "HAVE_FMA", 4: "HAVE_FMAF"}


def machine(real: Real, libm: bool) -> tuple[str, str]:
    """The operations of float64 or float32: text still to be narrowed, and text as it is."""
    single = real is not DOUBLE
    name = "fmaf" if single else "fma"
    fused = (_FUSED_SINGLE if single else _FUSED).replace("@FUSED@", FUSED[real.bytes])
    fused = fused.replace("@FMA@", f"libm::{name}" if libm else f"__builtin_{name}")
    if libm:
        roots = _LIBM.replace("@F@", "f" if single else "")
        own = fused + roots + ("" if single else _FAR_LIBM)
        return _BITS, own
    own = fused + (_ROOT_SINGLE if single else _ROOT + _NO_FAR)
    return _BITS + _ROUNDING, own
