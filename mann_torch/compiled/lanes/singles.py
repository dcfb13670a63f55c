"""C++ text of the elementary functions of float32 lanes.

The commonest have text of their own, at most 2 ulp; the methods are those of `exponentials` and
`logarithms`, tanh's that of Cephes (tanhf.c). The others go by way of float64 lanes, `Wide`, half
of the lanes at a time, and are all but rounded once; they are not inlined. Coefficients: weighted
minimax fits (Lawson's iteration).
"""

from .polynomials import polynomial

# (exp(r) - 1 - r) / r^2 for |r| <= ln(2) / 2.
_EXP = (
    0.4999999403953552, 0.1666652113199234, 0.04166838899254799, 0.0083687175065279,
    0.0013814596459269524,
)  # fmt: skip
# (log((1 + s) / (1 - s)) - 2 s) / s^3 in s^2, for (1 + s) / (1 - s) from sqrt(1/2) to sqrt(2).
_LOG = (
    0.6666666269302368, 0.4000033438205719, 0.28537294268608093, 0.2358243763446808,
)  # fmt: skip
# (tanh(x) - x) / x^3 in x^2, for |x| <= 0.625.
_TANH = (
    -0.3333328366279602, 0.133314847946167, -0.0537429116666317, 0.020648565143346786,
    -0.005714678205549717,
)  # fmt: skip

_OWN = f"""
// 2^n for a normal power.
fn V power_of_two(M n) {{ return from_bits(shl(n + 127, 23)); }}
// n, the nearest integer to x / ln 2, as both types.
fn M exp_halvings(V x, V* n) {{
  V shifted = fma(x, splat(1.44269504f), magic_());
  *n = shifted - magic_();
  return bits(shifted) - bits(magic_());
}}
// exp(r) - 1 - r + low, then exp(r) - 1.
fn V exp_tail(V r, V low) {{
  {polynomial("p", "r", _EXP)}
  return fma(p, r * r, low);
}}
fn M exp_reduce(V x, V* r) {{
  V n;
  M m = exp_halvings(x, &n);
  V first = fused(n, splat(-0.693147182464599609375f), x);
  *r = fma(n, splat(1.904654290582768e-9f), first);
  return m;
}}
// In two factors: the last product alone is rounded where the result is denormal.
fn V exp_(V x) {{
  V low = splat(-105.0f);
  V high = splat(90.0f);
  x = sel(lt(x, low), low, x);
  x = sel(gt(x, high), high, x);
  V r;
  M n = exp_reduce(x, &r);
  M half = n >> 1;
  V s = power_of_two(half);
  return fma(exp_tail(r, r), s, s) * power_of_two(n - half);
}}
fn V expm1_(V x) {{
  V low = splat(-20.0f);
  V high = splat(90.0f);
  V c = sel(lt(x, low), low, x);
  c = sel(gt(c, high), high, c);
  V n;
  M m = exp_halvings(c, &n);
  V first = fused(n, splat(-0.693147182464599609375f), c);
  V r = fma(n, splat(1.904654290582768e-9f), first);
  V r_low = fma(n, splat(1.904654290582768e-9f), first - r);
  V unit = splat(1.0f) - power_of_two(-imin(m, isplat(100)));
  V sum = unit + r;
  V sum_low = (unit - sum) + r;
  M half = m >> 1;
  V y = sum + (sum_low + exp_tail(r, r_low));
  return copysign_(y * power_of_two(half) * power_of_two(m - half), x);
}}
// Of exp(2 |x|) where |x| is large: 1 - 2 / (e + 1).
fn V tanh_(V x) {{
  V a = abs_(x);
  V z = x * x;
  {polynomial("p", "z", _TANH)}
  V near = fma(z * p, x, x);
  V limit = splat(10.0f);
  V c = sel(gt(a, limit), limit, a);
  V r;
  M n = exp_reduce(c + c, &r);
  V s = power_of_two(n);
  V e = fma(s, exp_tail(r, r), s);
  V far = splat(1.0f) - splat(2.0f) / (e + splat(1.0f));
  return sel(lt(a, splat(0.625f)), near, copysign_(far, x));
}}
// Of -|x|: it neither overflows nor loses what is denormal. What 1 + e loses is made good.
fn V sigmoid_(V x) {{
  V one = splat(1.0f);
  V e = exp_(-abs_(x));
  M up = ge(x, splat(0.0f));
  V d = one + e;
  V low = (one - d) + e;
  V y = sel(up, one, e) / d;
  return fma(y * low, -sel(up, y, one - y), y);
}}
// x = (1 + f) 2^k, denormal x included.
fn V log_(V x) {{
  M tiny = lt(x, splat(1.17549435e-38f));
  V y = sel(tiny, x * splat(33554432.0f), x);
  M e = isub(bits(y), isplat(0x3f3504f3)) >> 23;
  V f = from_bits(isub(bits(y), shl(e, 23))) - splat(1.0f);
  V k = to_double(e - mand(tiny, isplat(25)));
  V s = f / (splat(2.0f) + f);
  V z = s * s;
  {polynomial("p", "z", _LOG)}
  V half = splat(0.5f) * f * f;
  V low = fma(s, fma(z, p, half), k * splat(-1.904654290582768e-9f));
  y = fused(k, splat(0.693147182464599609375f), f - (half - low));
  V infinity = inf_();
  V edge = sel(eq(x, splat(0.0f)), -infinity, nan_());
  y = sel(gt(x, splat(0.0f)), y, edge);
  return sel(eq(x, infinity), x, y);
}}
"""

_ONE = """
    exp2 log2 log10 log1p sin cos tan asin acos atan sinh cosh asinh acosh atanh erf erfc
"""
_TWO = "fmod remainder hypot atan2 pow"


def singles(lanes: int) -> str:
    """Every elementary function, after `Wide` of `wide_lanes`."""
    one, two = _ONE.split(), _TWO.split()
    if lanes < 4:
        cast = "__builtin_convertvector({0}, {1})" if lanes > 1 else "({1})({0})"
        lines = [
            f"fn Wide::V widen(V a) {{ return {cast.format('a', 'Wide::V')}; }}",
            f"fn V narrow(Wide::V a) {{ return {cast.format('a', 'V')}; }}",
            *(f"slow V {f}_(V x) {{ return narrow(Wide::{f}_(widen(x))); }}" for f in one),
            *(
                f"slow V {f}_(V x, V y) {{ return narrow(Wide::{f}_(widen(x), widen(y))); }}"
                for f in two
            ),
        ]
        return _OWN + "\n".join(lines) + "\n"
    half = lanes // 2
    low, high, every = (
        ", ".join(map(str, range(*ends))) for ends in ((half,), (half, lanes), (lanes,))
    )
    convert, shuffle = "__builtin_convertvector", "__builtin_shufflevector"
    lines = [
        f"typedef float H __attribute__((vector_size({4 * half})));",
        f"fn Wide::V low(V a) {{ return {convert}({shuffle}(a, a, {low}), Wide::V); }}",
        f"fn Wide::V high(V a) {{ return {convert}({shuffle}(a, a, {high}), Wide::V); }}",
        "fn V joined(Wide::V a, Wide::V b) {",
        f"  return {shuffle}({convert}(a, H), {convert}(b, H), {every});",
        "}",
        *(
            f"slow V {f}_(V x) {{ return joined(Wide::{f}_(low(x)), Wide::{f}_(high(x))); }}"
            for f in one
        ),
    ]
    for f in two:
        lines.append(f"slow V {f}_(V x, V y) {{")
        parts = (f"Wide::{f}_({part}(x), {part}(y))" for part in ("low", "high"))
        lines += [f"  return joined({', '.join(parts)});", "}"]
    return _OWN + "\n".join(lines) + "\n"


def wide_lanes(lanes: int) -> int:
    """How many float64 lanes compute at a time."""
    return lanes if lanes < 4 else lanes // 2
