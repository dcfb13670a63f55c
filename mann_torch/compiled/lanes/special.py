"""C++ text of the power and of the error functions (see `lane_maths`).

The power follows SLEEF's: a logarithm in two doubles, since its error is multiplied by up to 709.
erfc(a) = exp(-a^2) g(a) / (1 + 2 a), g a polynomial in (a - K) / (a + K), after Shepherd and
Laframboise (1981). Coefficients: interpolation at Chebyshev nodes.
"""

from .polynomials import polynomial

# (log((1 + s) / (1 - s)) - 2 s - 2/3 s^3) / s^5 in s^2, for (1 + s) / (1 - s) as in `log_`.
_LOG_TAIL = (
    0.4, 0.28571428571429364, 0.22222222221656232, 0.18181818335314404, 0.15384594970895384,
    0.133348042382299, 0.11706248540800378, 0.11723051029373702,
)  # fmt: skip
# erf(x) / x - 1 in x^2, for |x| <= 1.
_ERF = (
    0.12837916709551256, -0.37612638903183354, 0.11283791670937436, -0.026866170642030607,
    0.005223977597232176, -0.0008548325503386967, 0.00012055280864487824,
    -1.4924468955710671e-05, 1.6444143191913873e-06, -1.6183555893573223e-07,
    1.361316063699201e-08, -7.598114344964609e-10,
)  # fmt: skip
# g for 1/2 <= a <= 28, K = 3.5.
_ERFC = (
    1.2423492448711544, -0.1400091801376194, -0.010555596332218151, 0.09751909515325563,
    -0.11508959816020042, 0.08798315382497571, -0.04882332582769667, 0.01909933094056669,
    -0.004215019910384933, -0.00030226786092849803, 0.0005643844370842721,
    -0.00012151250870843876, -4.278232062220953e-05, 2.4261220716444518e-05,
    2.3285625617049886e-06, -3.814991076700576e-06, -4.466283205177847e-08, 6.00951725853741e-07,
    -7.545055693454484e-09, -9.361273365147815e-08, 4.2783298300506434e-10,
    1.0591622351425399e-08,
)  # fmt: skip

_POWER = f"""
// log(x) in two doubles.
fn V log_double(V x, V* y_low) {{
  V f;
  V k = small_to_double(log_split(x, &f));
  V g = 2.0 + f;
  V g_low = f - (g - 2.0);
  V inverse = 1.0 / g;
  V s = f * inverse;
  V s_low = fma(-s, g_low, fused(-s, g, f)) * inverse;
  V z = s * s;
  {polynomial("p", "z", _LOG_TAIL)}
  V q = z * p;
  V t = q + 0.6666666666666666;
  V t_low = (0.6666666666666666 - t) + q + 3.700743415417188e-17;
  V square = mul(s, s);
  V square_low = fused(s, s, -square) + 2.0 * s * s_low;
  V cube = mul(square, s);
  V cube_low = fused(square, s, -cube) + fma(square, s_low, square_low * s);
  V v = mul(cube, t);
  V v_low = fused(cube, t, -v) + fma(cube, t_low, cube_low * t);
  V twice = 2.0 * s;
  V part = twice + v;
  V part_low = (twice - part) + v + fma(s_low, splat(2.0), v_low);
  V unit = mul(k, splat(0.6931471803691238));
  V sum = unit + part;
  V shift = sum - unit;
  V rest = (unit - (sum - shift)) + (part - shift);
  rest = rest + fma(k, splat(1.9082149292705877e-10), part_low);
  V y = sum + rest;
  *y_low = (sum - y) + rest;
  return y;
}}
// exp(x + x_low) = (p + p_low) 2^n.
fn M exp_parts(V x, V x_low, V* p, V* p_low) {{
  V n;
  M m = exp_halvings(x, &n);
  V first = fma(n, splat(-0.6931471803691238), x);
  V r = fma(n, splat(-1.9082149292705877e-10), first);
  V r_low = fma(n, splat(-1.9082149292705877e-10), first - r) + x_low;
  V t = r + r_low;
  r_low = (r - t) + r_low;
  V tail = exp_reduced(t) + r_low;
  V sum = 1.0 + tail;
  *p = sum;
  *p_low = (1.0 - sum) + tail;
  return m;
}}
fn V pow_(V x, V y) {{
  V zero = splat(0.0);
  V one = splat(1.0);
  V infinity = inf_();
  V a = abs_(x);
  V l_low;
  V l = log_double(a, &l_low);
  V e = mul(y, l);
  V e_low = fused(y, l, -e) + y * l_low;
  V low = splat(-760.0);
  V high = splat(720.0);
  M beyond = mnot(mand(gt(e, low), lt(e, high)));
  e_low = sel(beyond, zero, e_low);
  e = sel(lt(e, low), low, e);
  e = sel(gt(e, high), high, e);
  V p;
  V p_low;
  M n = exp_parts(e, e_low, &p, &p_low);
  V r = scaled(p, n);
  M up = mxor(gt(y, zero), lt(a, one));
  M edge = mor(eq(a, zero), mor(eq(a, infinity), eq(abs_(y), infinity)));
  r = sel(edge, sel(up, infinity, zero), r);
  M whole = eq(y, trunc_(y));
  M odd = mand(whole, ne(0.5 * y, trunc_(0.5 * y)));
  r = from_bits(bits(r) ^ mand(sign_bit(x), odd));
  V invalid = nan_();
  r = sel(mand(mand(lt(x, zero), gt(x, -infinity)), mnot(whole)), invalid, r);
  r = sel(mand(eq(a, one), whole), copysign_(one, r), r);
  r = sel(mor(ne(x, x), ne(y, y)), invalid, r);
  return sel(mor(eq(y, zero), eq(x, one)), one, r);
}}
"""

_ERROR_FUNCTIONS = f"""
fn V erf_inner(V x, V z) {{
  {polynomial("p", "z", _ERF)}
  return fma(x, p, x);
}}
fn V erfc_outer(V a) {{
  V limit = splat(28.0);
  a = sel(gt(a, limit), limit, a);
  V t = (a - 3.5) / (a + 3.5);
  {polynomial("slope", "t", _ERFC[1:])}
  V g = fma(slope, t, splat({_ERFC[0]!r}));
  V square = mul(a, a);
  V p;
  V p_low;
  M n = exp_parts(-square, -fused(a, a, -square), &p, &p_low);
  V d = fma(a, splat(2.0), splat(1.0));
  V d_low = fma(a, splat(2.0), 1.0 - d);
  V inverse = 1.0 / d;
  V q = mul(g, inverse);
  V q_low = fma(-q, d_low, fused(-q, d, g)) * inverse;
  V h = mul(p, q);
  return scaled(h + (fused(p, q, -h) + fma(p, q_low, p_low * q)), n);
}}
fn V erf_(V x) {{
  V a = abs_(x);
  V inner = erf_inner(a, a * a);
  return copysign_(sel(gt(a, splat(1.0)), 1.0 - erfc_outer(a), inner), x);
}}
fn V erfc_(V x) {{
  V a = abs_(x);
  V inner = 1.0 - erf_inner(x, x * x);
  V outer = erfc_outer(a);
  outer = sel(lt(x, splat(0.0)), 2.0 - outer, outer);
  return sel(gt(a, splat(0.5)), outer, inner);
}}
"""

SPECIAL = _POWER + _ERROR_FUNCTIONS
