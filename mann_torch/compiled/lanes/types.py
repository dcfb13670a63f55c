"""C++ text of the lane types and of the primitives that differ between one lane and several.

A value `V` holds one floating number per lane, an `M` one integer of as many bits; a mask is an `M`
of 0 or -1. Everything above the primitives is written once (`library`), as text that is C++, CUDA
and C99: results besides the first go by pointers. `SCALAR` and `CHOICES` are all of these too;
what a machine calls its operations is C++ and CUDA here, and C99 in `c99.machine`.
"""

import re

from ..real import DOUBLE, FLOAT, Real

LANE_COUNTS = (1, 2, 4, 8, 16)


def lane_types(lanes: int, real: Real = DOUBLE) -> str:
    """The two typedefs; they stand before the struct, in the same function."""
    check_lanes(lanes)
    if lanes == 1:
        return f"typedef {real.name} V;\ntypedef {real.whole} M;\n"
    attribute = f"__attribute__((vector_size({real.bytes * lanes})))"
    return f"typedef {real.name} V {attribute};\ntypedef {real.whole} M {attribute};\n"


def check_lanes(lanes: int) -> None:
    if lanes not in LANE_COUNTS:
        raise ValueError(f"lanes must be one of {LANE_COUNTS}, got {lanes}")


def primitives(lanes: int, real: Real = DOUBLE) -> str:
    """The primitives, each a line `fn TYPE name(...) {...}` (see `lane_maths`)."""
    own = SCALAR + _BITS if lanes == 1 else _VECTOR.replace("@ALL@", ", ".join(["a"] * lanes))
    text = own + _MACHINE + CHOICES
    return narrowed(text) if real is FLOAT else text


#: What the bits and intrinsics of float64 are called, and those of float32 in their place.
_NARROWED = {
    "long long": "int",
    r"\bdouble": "float",
    "__double_as_longlong": "__float_as_int",
    "__longlong_as_double": "__int_as_float",
    "__fma_rn": "__fmaf_rn",
    "__dmul_rn": "__fmul_rn",
    "__dsqrt_rn": "__fsqrt_rn",
    "6755399441055744.0": "12582912.0",
    "9223372036854775808.0": "2147483648.0",
    "4503599627370496.0": "8388608.0",
    "0x7ff0000000000000LL": "0x7f800000",
    "0x7ff8000000000000LL": "0x7fc00000",
    "0x7fffffffffffffffLL": "0x7fffffff",
}


def narrowed(text: str) -> str:
    """Text of float64 arithmetic that means the same in float32, as such."""
    for wide, narrow in _NARROWED.items():
        text = re.sub(wide, narrow, text)
    return text


# NaN compares false, except under `ne`. The negated product keeps a mask 0 / -1. Integers wrap.
SCALAR = """
fn V splat(double a) { return a; }
fn M isplat(long long a) { return a; }
fn M lt(V a, V b) { return -(M)(a < b); }
fn M le(V a, V b) { return -(M)(a <= b); }
fn M gt(V a, V b) { return -(M)(a > b); }
fn M ge(V a, V b) { return -(M)(a >= b); }
fn M eq(V a, V b) { return -(M)(a == b); }
fn M ne(V a, V b) { return -(M)(a != b); }
fn M ilt(M a, M b) { return -(M)(a < b); }
fn M ile(M a, M b) { return -(M)(a <= b); }
fn M igt(M a, M b) { return -(M)(a > b); }
fn M ige(M a, M b) { return -(M)(a >= b); }
fn M ieq(M a, M b) { return -(M)(a == b); }
fn M ine(M a, M b) { return -(M)(a != b); }
fn V to_double(M a) { return (double)a; }
fn M to_int_raw(V a) { return (long long)a; }
fn bool any(M a) { return a != 0; }
fn bool all(M a) { return a == -1; }
fn double get(V a, int i) { (void)i; return a; }
fn long long iget(M a, int i) { (void)i; return a; }
fn void put(V* a, int i, double b) { (void)i; *a = b; }
fn void iput(M* a, int i, long long b) { (void)i; *a = b; }
fn M iadd(M a, M b) { return (M)((unsigned long long)a + (unsigned long long)b); }
fn M isub(M a, M b) { return (M)((unsigned long long)a - (unsigned long long)b); }
fn M imul(M a, M b) { return (M)((unsigned long long)a * (unsigned long long)b); }
fn M shl(M a, int n) { return (M)((unsigned long long)a << n); }
"""
_BITS = """#if defined(__CUDA_ARCH__)
fn M bits(V a) { return __double_as_longlong(a); }
fn V from_bits(M a) { return __longlong_as_double(a); }
fn V fma(V a, V b, V c) { return __fma_rn(a, b, c); }
fn V mul(V a, V b) { return __dmul_rn(a, b); }
fn V sqrt_(V a) { return __dsqrt_rn(a); }
fn V floor_(V a) { return ::floor(a); }
fn V ceil_(V a) { return ::ceil(a); }
fn V trunc_(V a) { return ::trunc(a); }
fn V round_(V a) { return ::rint(a); }
#else
fn M bits(V a) { return __builtin_bit_cast(M, a); }
fn V from_bits(M a) { return __builtin_bit_cast(V, a); }
#endif
"""

_VECTOR = """
fn V splat(double a) { return V{@ALL@}; }
fn M isplat(long long a) { return M{@ALL@}; }
fn M lt(V a, V b) { return a < b; }
fn M le(V a, V b) { return a <= b; }
fn M gt(V a, V b) { return a > b; }
fn M ge(V a, V b) { return a >= b; }
fn M eq(V a, V b) { return a == b; }
fn M ne(V a, V b) { return a != b; }
fn M ilt(M a, M b) { return a < b; }
fn M ile(M a, M b) { return a <= b; }
fn M igt(M a, M b) { return a > b; }
fn M ige(M a, M b) { return a >= b; }
fn M ieq(M a, M b) { return a == b; }
fn M ine(M a, M b) { return a != b; }
fn V to_double(M a) { return __builtin_convertvector(a, V); }
fn M to_int_raw(V a) { return __builtin_convertvector(a, M); }
fn bool any(M a) { return __builtin_reduce_or(a) != 0; }
fn bool all(M a) { return __builtin_reduce_and(a) == -1; }
fn double get(V a, int i) { return a[i]; }
fn long long iget(M a, int i) { return a[i]; }
fn void put(V* a, int i, double b) { (*a)[i] = b; }
fn void iput(M* a, int i, long long b) { (*a)[i] = b; }
fn M iadd(M a, M b) { return a + b; }
fn M isub(M a, M b) { return a - b; }
fn M imul(M a, M b) { return a * b; }
fn M shl(M a, int n) { return a << n; }
fn M bits(V a) { return (M)a; }
fn V from_bits(M a) { return (V)a; }
"""

# `mul` is the product rounded once, whatever the compiler would contract. `fused` is an fma whose
# exact product matters, `fma` one that C99 may round twice.
_MACHINE = """
#if !defined(__CUDA_ARCH__)
fn V fma(V a, V b, V c) { return __builtin_elementwise_fma(a, b, c); }
fn V mul(V a, V b) { return a * b; }
fn V sqrt_(V a) { return __builtin_elementwise_sqrt(a); }
fn V floor_(V a) { return __builtin_elementwise_floor(a); }
fn V ceil_(V a) { return __builtin_elementwise_ceil(a); }
fn V trunc_(V a) { return __builtin_elementwise_trunc(a); }
fn V round_(V a) { return __builtin_elementwise_roundeven(a); }
#endif
fn V fused(V a, V b, V c) { return fma(a, b, c); }
"""
# `to_int` yields the smallest integer for what no integer holds, as x86 does.
CHOICES = """
fn V sel(M m, V a, V b) { return m ? a : b; }
fn M isel(M m, M a, M b) { return m ? a : b; }
fn M mand(M a, M b) { return a & b; }
fn M mor(M a, M b) { return a | b; }
fn M mxor(M a, M b) { return a ^ b; }
fn M mnot(M a) { return ~a; }
// Added and taken away again, it rounds to an integer, and leaves that in the sum's low bits.
fn V magic_() { return splat(6755399441055744.0); }
fn V inf_() { return from_bits(isplat(0x7ff0000000000000LL)); }
fn V nan_() { return from_bits(isplat(0x7ff8000000000000LL)); }
fn V mask_to_double(M a) { return from_bits(a & bits(splat(1.0))); }
fn M to_int(V a) {
  V limit = splat(9223372036854775808.0);
  return to_int_raw(sel(mand(lt(a, limit), ge(a, -limit)), a, -limit));
}
"""
