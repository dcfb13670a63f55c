"""C++ text of the logarithms and the inverse hyperbolic functions (see `lane_maths`).

The series in s = f / (2 + f) and the splitting of ln 2 are fdlibm's (e_log.c). Coefficients:
weighted minimax fits (Lawson's iteration) in 60 digits.
"""

from .polynomials import polynomial

# (log((1 + s) / (1 - s)) - 2 s) / s^3 in s^2, for (1 + s) / (1 - s) from sqrt(1/2) to sqrt(2).
_LOG = (
    0.6666666666666734, 0.3999999999941672, 0.2857142874200424, 0.2222219860780833,
    0.18183562701213857, 0.15314088757293878, 0.14795593915242505,
)  # fmt: skip

LOGARITHMS = f"""
// The exponent that leaves a fraction from sqrt(1/2) to sqrt(2).
fn M log_exponent(V x) {{ return isub(bits(x), isplat(0x3fe6a09e667f3bcdLL)) >> 52; }}
fn V small_to_double(M n) {{
  return from_bits(n + bits(magic_())) - magic_();
}}
// log(1 + f) + k ln 2; `extra` holds k times the low part of ln 2, and more.
fn V log_sum(V f, V k, V extra) {{
  V s = f / (2.0 + f);
  V z = s * s;
  {polynomial("p", "z", _LOG)}
  V half = 0.5 * f * f;
  V low = fma(s, fma(z, p, half), extra);
  return fma(k, splat(0.6931471803691238), f - (half - low));
}}
fn V log_reduced(V f, V k) {{ return log_sum(f, k, k * 1.9082149292705877e-10); }}
// y, but for an x where a logarithm has no finite value.
fn V log_edges(V y, V x) {{
  V infinity = inf_();
  V edge = sel(eq(x, splat(0.0)), -infinity, nan_());
  y = sel(gt(x, splat(0.0)), y, edge);
  return sel(eq(x, infinity), x, y);
}}
// x = (1 + f) 2^k, denormal x included.
fn M log_split(V x, V* f) {{
  M tiny = lt(x, splat(2.2250738585072014e-308));
  V scaled_x = sel(tiny, x * 18014398509481984.0, x);
  M e = log_exponent(scaled_x);
  *f = from_bits(isub(bits(scaled_x), shl(e, 52))) - 1.0;
  return e - mand(tiny, isplat(54));
}}
fn V log_(V x) {{
  V f;
  V k = small_to_double(log_split(x, &f));
  return log_edges(log_reduced(f, k), x);
}}
// k times the unit + log(1 + f) times the factor, each in two doubles: exact powers stay exact.
fn V log_times(V x, V factor_high, V factor_low, V unit_high, V unit_low) {{
  V f;
  V k = small_to_double(log_split(x, &f));
  V s = f / (2.0 + f);
  V z = s * s;
  {polynomial("p", "z", _LOG)}
  V half = mul(splat(0.5), mul(f, f));
  V high = f - half;
  V low = (f - high) - half;
  low = fma(s, fma(z, p, half), low);
  V t = mul(high, factor_high);
  V t_low = fused(high, factor_high, -t) + (high * factor_low + low * factor_high);
  V base = mul(k, unit_high);
  V sum = base + t;
  V rest = (t - (sum - base)) + fma(k, unit_low, t_low);
  return log_edges(sum + rest, x);
}}
fn V log2_(V x) {{
  return log_times(x, splat(1.4426950408889634), splat(2.0355273740931033e-17), splat(1.0),
                   splat(0.0));
}}
fn V log10_(V x) {{
  return log_times(x, splat(0.4342944819032518), splat(1.098319650216765e-17),
                   splat(0.3010299955494702), splat(1.1451100898021838e-10));
}}
// 1 + x = (1 + f) 2^k with f rounded once; s = 2^-k.
fn V log1p_split(V x, V* k, V* s) {{
  M far = gt(x, splat(0x1p600));
  V y = sel(far, x * 0x1p-500, x);
  M e = log_exponent(1.0 + y);
  *k = small_to_double(e + mand(far, isplat(500)));
  V scale = power_of_two(-e);
  *s = scale;
  return fma(y, scale, scale - 1.0);
}}
fn V log1p_(V x) {{
  V k;
  V s;
  V f = log1p_split(x, &k, &s);
  return copysign_(log_edges(log_reduced(f, k), 1.0 + x), x);
}}
// log(1 + x + x_low) + extra ln 2.
fn V log1p_sum(V x, V x_low, V extra) {{
  V k;
  V s;
  V f = log1p_split(x, &k, &s);
  V f_low = x_low * s * fma(f, f - 1.0, splat(1.0));
  k = k + extra;
  return log_sum(f, k, fma(k, splat(1.9082149292705877e-10), f_low));
}}
fn V asinh_(V x) {{
  V a = abs_(x);
  M far = gt(a, splat(0x1p60));
  V square = a * a;
  V w = square / (1.0 + sqrt_(1.0 + square));
  V sum = a + w;
  V low = w - (sum - a);
  low = sel(gt(w, a), a - (sum - w), low);
  V y = log1p_sum(sel(far, a, sum), sel(far, splat(0.0), low), mask_to_double(far));
  y = sel(lt(a, inf_()), y, a);
  return copysign_(y, x);
}}
fn V acosh_(V x) {{
  M far = gt(x, splat(0x1p60));
  V t = x - 1.0;
  V w = sqrt_(fma(t, t, 2.0 * t));
  V sum = w + t;
  V low = sel(gt(w, t), t - (sum - w), w - (sum - t));
  V y = log1p_sum(sel(far, x, sum), sel(far, splat(0.0), low), mask_to_double(far));
  y = sel(lt(x, inf_()), y, x);
  return sel(lt(x, splat(1.0)), nan_(), y);
}}
fn V atanh_(V x) {{
  V a = abs_(x);
  V d = 1.0 - a;
  V d_low = (1.0 - d) - a;
  V q = 2.0 * a / d;
  V q_low = fma(-q, d_low, fused(-q, d, 2.0 * a)) / d;
  V y = 0.5 * log1p_sum(q, q_low, splat(0.0));
  y = sel(eq(a, splat(1.0)), inf_(), y);
  y = sel(gt(a, splat(1.0)), nan_(), y);
  return copysign_(y, x);
}}
"""
