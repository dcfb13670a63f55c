"""C++ text of exponentials, logarithms, hyperbolic functions and powers (see `lane_maths`).

Reductions after Cody and Waite; the logarithm's series in s = f / (2 + f) and the splitting of ln 2
after fdlibm (e_log.c). Coefficients: weighted minimax fits (Lawson's iteration) in 60 digits.
"""

from mann_torch.compiled.lane_polynomials import polynomial

# (exp(r) - 1 - r) / r^2 for |r| <= ln(2) / 2.
_EXP = (
    0.5000000000000006, 0.16666666666666685, 0.041666666666573655, 0.008333333333315134,
    0.0013888888932362662, 0.0001984126990183639, 2.4801504469959504e-05, 2.755722903280276e-06,
    2.76263156818556e-07, 2.5114128761796518e-08,
)  # fmt: skip
# (log((1 + s) / (1 - s)) - 2 s) / s^3 in s^2, for (1 + s) / (1 - s) from sqrt(1/2) to sqrt(2).
_LOG = (
    0.6666666666666734, 0.3999999999941672, 0.2857142874200424, 0.2222219860780833,
    0.18183562701213857, 0.15314088757293878, 0.14795593915242505,
)  # fmt: skip
# (sinh(r) - r) / r^3 in r^2, for |r| <= 1.
_SINH = (
    0.16666666666666669, 0.008333333333332915, 0.0001984126984158948, 2.755731910830398e-06,
    2.5052130724092762e-08, 1.6056681678864722e-10, 7.775907465268037e-13,
)  # fmt: skip

_EXPONENTIALS = f"""
fn V power_of_two(M n) {{ return from_bits((n + 1023) << 52); }}
fn V scaled(V p, M n) {{
  M half = n >> 1;
  return p * power_of_two(half) * power_of_two(n - half);
}}
fn V scaled_sum(V p, M n) {{
  M half = n >> 1;
  V s = power_of_two(half);
  return fma(p, s, s) * power_of_two(n - half);
}}
fn V exp_tail(V r, V low) {{
  {polynomial("p", "r", _EXP)}
  return fma(p, r * r, low);
}}
fn V exp_reduced(V r) {{ return exp_tail(r, r); }}
fn M exp_reduce(V x, V& r) {{
  V magic = splat(6755399441055744.0);
  V shifted = fma(x, splat(1.4426950408889634), magic);
  V n = shifted - magic;
  r = fma(n, splat(-0.6931471803691238), x);
  r = fma(n, splat(-1.9082149292705877e-10), r);
  return bits(shifted) - bits(magic);
}}
fn V exp_times(V x, long long extra) {{
  V low = splat(-760.0);
  V high = splat(720.0);
  x = sel(lt(x, low), low, x);
  x = sel(gt(x, high), high, x);
  V r;
  M n = exp_reduce(x, r);
  return scaled_sum(exp_reduced(r), n + extra);
}}
fn V exp_(V x) {{ return exp_times(x, 0); }}
fn V exp2_(V x) {{
  V low = splat(-1100.0);
  V high = splat(1100.0);
  x = sel(lt(x, low), low, x);
  x = sel(gt(x, high), high, x);
  V magic = splat(6755399441055744.0);
  V shifted = x + magic;
  V f = x - (shifted - magic);
  V r = f * 0.6931471805599453;
  r = fma(f, splat(2.3190468138462996e-17), r);
  return scaled_sum(exp_reduced(r), bits(shifted) - bits(magic));
}}
fn V expm1_(V x) {{
  V low = splat(-50.0);
  V high = splat(720.0);
  V c = sel(lt(x, low), low, x);
  c = sel(gt(c, high), high, c);
  V magic = splat(6755399441055744.0);
  V shifted = fma(c, splat(1.4426950408889634), magic);
  V n = shifted - magic;
  M m = bits(shifted) - bits(magic);
  V first = fma(n, splat(-0.6931471803691238), c);
  V r = fma(n, splat(-1.9082149292705877e-10), first);
  V r_low = fma(n, splat(-1.9082149292705877e-10), first - r);
  V unit = 1.0 - power_of_two(-imin(m, isplat(1000)));
  V sum = unit + r;
  V sum_low = (unit - sum) + r;
  return copysign_(scaled(sum + (sum_low + exp_tail(r, r_low)), m), x);
}}
fn V expm1_negative(V x) {{
  V r;
  M n = exp_reduce(x, r);
  V s = power_of_two(n);
  return fma(s, exp_reduced(r), s - 1.0);
}}
fn V tanh_(V x) {{
  V a = abs_(x);
  V limit = splat(22.0);
  a = sel(gt(a, limit), limit, a);
  V t = expm1_negative(-2.0 * a);
  return copysign_(-t / (t + 2.0), x);
}}
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

_LOGARITHMS = f"""
fn M log_exponent(V x) {{ return (bits(x) - 0x3fe6a09e667f3bcdLL) >> 52; }}
fn V small_to_double(M n) {{
  V magic = splat(6755399441055744.0);
  return from_bits(n + bits(magic)) - magic;
}}
fn V log_sum(V f, V k, V extra) {{
  V s = f / (2.0 + f);
  V z = s * s;
  {polynomial("p", "z", _LOG)}
  V half = 0.5 * f * f;
  V low = fma(s, fma(z, p, half), extra);
  return fma(k, splat(0.6931471803691238), f - (half - low));
}}
fn V log_reduced(V f, V k) {{ return log_sum(f, k, k * 1.9082149292705877e-10); }}
fn V log_edges(V y, V x) {{
  V infinity = inf_();
  V edge = sel(eq(x, splat(0.0)), -infinity, nan_());
  y = sel(gt(x, splat(0.0)), y, edge);
  return sel(eq(x, infinity), x, y);
}}
fn M log_split(V x, V& f) {{
  M tiny = lt(x, splat(2.2250738585072014e-308));
  V scaled_x = sel(tiny, x * 18014398509481984.0, x);
  M e = log_exponent(scaled_x);
  f = from_bits(bits(scaled_x) - (e << 52)) - 1.0;
  return e - mand(tiny, isplat(54));
}}
fn V log_(V x) {{
  V f;
  V k = small_to_double(log_split(x, f));
  return log_edges(log_reduced(f, k), x);
}}
fn V log_times(V x, V factor_high, V factor_low, V unit_high, V unit_low) {{
  V f;
  V k = small_to_double(log_split(x, f));
  V s = f / (2.0 + f);
  V z = s * s;
  {polynomial("p", "z", _LOG)}
  V half = mul(splat(0.5), mul(f, f));
  V high = f - half;
  V low = (f - high) - half;
  low = fma(s, fma(z, p, half), low);
  V t = mul(high, factor_high);
  V t_low = fma(high, factor_high, -t) + (high * factor_low + low * factor_high);
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
fn V log1p_split(V x, V& k, V& s) {{
  M far = gt(x, splat(0x1p600));
  V y = sel(far, x * 0x1p-500, x);
  M e = log_exponent(1.0 + y);
  k = small_to_double(e + mand(far, isplat(500)));
  s = power_of_two(-e);
  return fma(y, s, s - 1.0);
}}
fn V log1p_(V x) {{
  V k;
  V s;
  V f = log1p_split(x, k, s);
  return copysign_(log_edges(log_reduced(f, k), 1.0 + x), x);
}}
fn V log1p_sum(V x, V x_low, V extra) {{
  V k;
  V s;
  V f = log1p_split(x, k, s);
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
  V q_low = fma(-q, d_low, fma(-q, d, 2.0 * a)) / d;
  V y = 0.5 * log1p_sum(q, q_low, splat(0.0));
  y = sel(eq(a, splat(1.0)), inf_(), y);
  y = sel(gt(a, splat(1.0)), nan_(), y);
  return copysign_(y, x);
}}
"""

ELEMENTARY = _EXPONENTIALS + _LOGARITHMS
