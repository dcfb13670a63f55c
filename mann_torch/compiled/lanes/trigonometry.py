"""C++ text of the circular functions and their inverses (see `lane_maths`).

Cody and Waite's reduction by pi / 2 with fused products is good to 1e9; beyond, the C library
reduces lane by lane. Coefficients: weighted minimax fits (Lawson's iteration) in 60 digits.
"""

from .polynomials import polynomial

# (sin(r) - r) / r^3 and (cos(r) - 1) / r^2 in r^2, for |r| <= pi / 4.
_SIN = (
    -0.16666666666666632, 0.008333333333322491, -0.00019841269829859668, 2.755731370771254e-06,
    -2.5050760355428988e-08, 1.5896915807874983e-10, 0.0,
)  # fmt: skip
_COS = (
    -0.5, 0.041666666666666595, -0.0013888888888873344, 2.480158728900409e-05,
    -2.7557314217720786e-07, 2.087570549605785e-09, -1.135875461724814e-11,
)  # fmt: skip
# (atan(t) - t) / t^3 in t^2, for |t| <= 1 / 2.
_ATAN = (
    -0.33333333333332993, 0.1999999999990567, -0.14285714276591718, 0.11111110667892601,
    -0.0909089643723562, 0.07692076735678134, -0.06663837746700228, 0.05858472324005832,
    -0.05122736428668684, 0.04188453815885337, -0.02746480055642998, 0.010136829598340783,
)  # fmt: skip
# (asin(t) - t) / t^3 in t^2, for |t| <= 1 / 2.
_ASIN = (
    0.16666666666666763, 0.0749999999997017, 0.04464285717519153, 0.03038194268076619,
    0.022372215730033725, 0.017351598979149934, 0.013980973503437783, 0.011397685720773655,
    0.010786997005157117, 0.0036813933368370715, 0.021767266599317332, -0.021082328742440832,
    0.032679879778989396,
)  # fmt: skip

_FAR = "".join(
    f"""
slow V {name}_far(V x, M far, V y) {{
  for (int i = 0; i < @LANES@; ++i) {{
    if (iget(far, i) != 0) put(&y, i, far_{name}(get(x, i)));
  }}
  return y;
}}
"""
    for name in ("sin", "cos", "tan")
)

_CIRCULAR = f"""
// sin(r + quadrant pi / 2), by both polynomials: where the sine and the cosine of one number are
// wanted, as in every derivative, the compiler finds all but the last choice twice.
fn V circular(V r, M quadrant) {{
  V z = r * r;
  {polynomial("p", "z", _SIN[:-1])}
  {polynomial("q", "z", _COS)}
  V y = sel(ine(quadrant & 1, isplat(0)), fma(z, q, splat(1.0)), fma(z * r, p, r));
  return from_bits(bits(y) ^ shl(quadrant & 2, 62));
}}
// n, the nearest integer to a / (pi / 2); its low bits are those of the result.
fn M quarter_turns(V a, V* n) {{
  V shifted = fma(a, splat(0.6366197723675814), magic_());
  *n = shifted - magic_();
  return bits(shifted);
}}
fn V less_quarter_turns(V a, V n) {{
  V r = fused(n, splat(-1.5707963267948966), a);
  r = fused(n, splat(-6.123233995736766e-17), r);
  return fma(n, splat(1.4973849048591698e-33), r);
}}
fn V sin_(V x) {{
  V a = abs_(x);
  V n;
  M quadrant = quarter_turns(a, &n);
  V y = from_bits(bits(circular(less_quarter_turns(a, n), quadrant)) ^ sign_bit(x));
  M far = gt(a, splat(1e9));
  return any(far) ? sin_far(x, far, y) : y;
}}
fn V cos_(V x) {{
  V a = abs_(x);
  V n;
  M quadrant = quarter_turns(a, &n);
  V y = circular(less_quarter_turns(a, n), quadrant + 1);
  M far = gt(a, splat(1e9));
  return any(far) ? cos_far(x, far, y) : y;
}}
// Sine and cosine in two doubles each, so that the quotient is all but rounded once.
fn V tan_(V x) {{
  V a = abs_(x);
  V n;
  M quadrant = quarter_turns(a, &n);
  V first = fused(n, splat(-1.5707963267948966), a);
  V w = mul(n, splat(-6.123233995736766e-17));
  V w_low = fused(n, splat(-6.123233995736766e-17), -w);
  V r = first + w;
  V shift = r - first;
  V r_low = (first - (r - shift)) + (w - shift);
  r_low = r_low + fma(n, splat(1.4973849048591698e-33), w_low);
  V z = mul(r, r);
  {polynomial("p", "z", _SIN[:-1])}
  {polynomial("q", "z", _COS[1:])}
  V half = 0.5 * z;
  V tail = fma(z * p, r, fma(-half, r_low, r_low));
  V sine = r + tail;
  V sine_low = (r - sine) + tail;
  V one_less = 1.0 - half;
  tail = ((1.0 - one_less) - half) + fma(z * z, q, -r * r_low);
  V cosine = one_less + tail;
  V cosine_low = (one_less - cosine) + tail;
  M odd = ine(quadrant & 1, isplat(0));
  V top = sel(odd, -cosine, sine);
  V below = sel(odd, sine, cosine);
  V inverse = 1.0 / below;
  V y = mul(top, inverse);
  V rest = fma(-y, sel(odd, sine_low, cosine_low), sel(odd, -cosine_low, sine_low));
  y = fma(fused(-y, below, top) + rest, inverse, y);
  y = from_bits(bits(y) ^ sign_bit(x));
  M far = gt(a, splat(1e9));
  return any(far) ? tan_far(x, far, y) : y;
}}
"""

# From 1/2 on a - 1 is exact; the three cases keep |t| <= 1 / 2.
_INVERSE = f"""
fn V atan_reduced(V t) {{
  V z = t * t;
  {polynomial("p", "z", _ATAN)}
  return fma(z * p, t, t);
}}
fn V atan_offset(M big, M middle) {{
  return sel(big, splat(1.5707963267948966),
             sel(middle, splat(0.7853981633974483), splat(0.0)));
}}
fn V atan_offset_low(M big, M middle) {{
  return sel(big, splat(6.123233995736766e-17),
             sel(middle, splat(3.061616997868383e-17), splat(0.0)));
}}
fn V atan_(V x) {{
  V a = abs_(x);
  M big = gt(a, splat(2.25));
  M middle = gt(a, splat(0.5));
  V numerator = sel(big, splat(-1.0), sel(middle, a - 1.0, a));
  V denominator = sel(big, a, sel(middle, a + 1.0, splat(1.0)));
  V t = atan_reduced(numerator / denominator) + atan_offset_low(big, middle);
  return copysign_(atan_offset(big, middle) + t, x);
}}
fn V atan2_(V y, V x) {{
  V a = abs_(x);
  V b = abs_(y);
  V infinity = inf_();
  M both = mand(eq(a, infinity), eq(b, infinity));
  a = sel(both, splat(1.0), a);
  b = sel(both, splat(1.0), b);
  V scale = sel(gt(max_(a, b), splat(0x1p1000)), splat(0x1p-50), splat(1.0));
  a = a * scale;
  b = b * scale;
  M big = gt(b, 2.25 * a);
  M middle = gt(b, 0.5 * a);
  V numerator = sel(big, -a, sel(middle, b - a, b));
  V denominator = sel(big, b, sel(middle, b + a, a));
  denominator = sel(mand(eq(a, splat(0.0)), eq(b, splat(0.0))), splat(1.0), denominator);
  V t = atan_reduced(numerator / denominator) + atan_offset_low(big, middle);
  V high = atan_offset(big, middle);
  V turned = (3.141592653589793 - high) - (t - 1.2246467991473532e-16);
  return copysign_(sel(ilt(bits(x), isplat(0)), turned, high + t), y);
}}
fn V asin_tail(V t, V z) {{
  {polynomial("p", "z", _ASIN)}
  return z * p * t;
}}
fn V asin_(V x) {{
  V a = abs_(x);
  M big = gt(a, splat(0.5));
  V z = sel(big, fma(a, splat(-0.5), splat(0.5)), a * a);
  V t = sel(big, sqrt_(z), a);
  V tail = asin_tail(t, z);
  V twice = 2.0 * t;
  V high = 1.5707963267948966 - twice;
  V low = ((1.5707963267948966 - high) - twice) + 6.123233995736766e-17;
  return copysign_(sel(big, high + (low - 2.0 * tail), t + tail), x);
}}
fn V acos_(V x) {{
  V a = abs_(x);
  M big = gt(a, splat(0.5));
  V z = sel(big, fma(a, splat(-0.5), splat(0.5)), a * a);
  V t = sel(big, sqrt_(z), x);
  V p = t + asin_tail(t, z);
  V y = sel(ilt(bits(x), isplat(0)),
            3.141592653589793 - (2.0 * p - 1.2246467991473532e-16), 2.0 * p);
  return sel(big, y, 1.5707963267948966 - (p - 6.123233995736766e-17));
}}
"""

TRIGONOMETRY = _FAR + _CIRCULAR + _INVERSE
