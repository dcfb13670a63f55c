"""C++ text of the exponentials and the hyperbolic functions (see `lane_maths`).

Reduction after Cody and Waite, ln 2 split after fdlibm. Coefficients: weighted minimax fits
(Lawson's iteration) in 60 digits, the leading ones rounded before the rest is fitted.
"""

from .polynomials import polynomial

# (exp(r) - 1 - r) / r^2 for |r| <= ln(2) / 2.
_EXP = (
    0.5000000000000006, 0.16666666666666685, 0.041666666666573655, 0.008333333333315134,
    0.0013888888932362662, 0.0001984126990183639, 2.4801504469959504e-05, 2.755722903280276e-06,
    2.76263156818556e-07, 2.5114128761796518e-08,
)  # fmt: skip
# (sinh(r) - r) / r^3 in r^2, for |r| <= 1.
_SINH = (
    0.16666666666666669, 0.008333333333332915, 0.0001984126984158948, 2.755731910830398e-06,
    2.5052130724092762e-08, 1.6056681678864722e-10, 7.775907465268037e-13,
)  # fmt: skip

EXPONENTIALS = f"""
// 2^n for a normal power.
fn V power_of_two(M n) {{ return from_bits(shl(n + 1023, 52)); }}
// p 2^n in two factors: the first product is exact, so denormal results are rounded once.
fn V scaled(V p, M n) {{
  M half = n >> 1;
  return p * power_of_two(half) * power_of_two(n - half);
}}
// (1 + p) 2^n.
fn V scaled_sum(V p, M n) {{
  M half = n >> 1;
  V s = power_of_two(half);
  return fma(p, s, s) * power_of_two(n - half);
}}
// exp(r) - 1 - r + low, then exp(r) - 1.
fn V exp_tail(V r, V low) {{
  {polynomial("p", "r", _EXP)}
  return fma(p, r * r, low);
}}
fn V exp_reduced(V r) {{ return exp_tail(r, r); }}
// n, the nearest integer to x / ln 2, as both types.
fn M exp_halvings(V x, V* n) {{
  V shifted = fma(x, splat(1.4426950408889634), magic_());
  *n = shifted - magic_();
  return bits(shifted) - bits(magic_());
}}
fn M exp_reduce(V x, V* r) {{
  V n;
  M m = exp_halvings(x, &n);
  V first = fma(n, splat(-0.6931471803691238), x);
  *r = fma(n, splat(-1.9082149292705877e-10), first);
  return m;
}}
// exp(x) 2^extra, within range wherever the result is.
fn V exp_times(V x, long long extra) {{
  V low = splat(-760.0);
  V high = splat(720.0);
  x = sel(lt(x, low), low, x);
  x = sel(gt(x, high), high, x);
  V r;
  M n = exp_reduce(x, &r);
  return scaled_sum(exp_reduced(r), n + extra);
}}
fn V exp_(V x) {{ return exp_times(x, 0); }}
fn V exp2_(V x) {{
  V low = splat(-1100.0);
  V high = splat(1100.0);
  x = sel(lt(x, low), low, x);
  x = sel(gt(x, high), high, x);
  V shifted = x + magic_();
  V f = x - (shifted - magic_());
  V r = f * 0.6931471805599453;
  r = fma(f, splat(2.3190468138462996e-17), r);
  return scaled_sum(exp_reduced(r), bits(shifted) - bits(magic_()));
}}
fn V expm1_(V x) {{
  V low = splat(-50.0);
  V high = splat(720.0);
  V c = sel(lt(x, low), low, x);
  c = sel(gt(c, high), high, c);
  V n;
  M m = exp_halvings(c, &n);
  V first = fma(n, splat(-0.6931471803691238), c);
  V r = fma(n, splat(-1.9082149292705877e-10), first);
  V r_low = fma(n, splat(-1.9082149292705877e-10), first - r);
  V unit = 1.0 - power_of_two(-imin(m, isplat(1000)));
  V sum = unit + r;
  V sum_low = (unit - sum) + r;
  return copysign_(scaled(sum + (sum_low + exp_tail(r, r_low)), m), x);
}}
// By exp(2 a) - 1 rather than exp(-2 a) - 1: near 1 its error cancels.
fn V tanh_(V x) {{
  V a = abs_(x);
  V limit = splat(22.0);
  a = sel(gt(a, limit), limit, a);
  V r;
  M n = exp_reduce(2.0 * a, &r);
  V s = power_of_two(n);
  V t = fma(s, exp_reduced(r), s - 1.0);
  return copysign_(t / (t + 2.0), x);
}}
// Of -|x|: it neither overflows nor loses what is denormal.
fn V sigmoid_(V x) {{
  V e = exp_times(-abs_(x), 0);
  return sel(ge(x, splat(0.0)), splat(1.0), e) / (1.0 + e);
}}
fn V cosh_(V x) {{
  V h = exp_times(abs_(x), -1);
  return h + 0.25 / h;
}}
fn V sinh_(V x) {{
  V a = abs_(x);
  V z = a * a;
  {polynomial("p", "z", _SINH)}
  V h = exp_times(a, -1);
  return copysign_(sel(lt(a, splat(1.0)), fma(p, z * a, a), h - 0.25 / h), x);
}}
"""
