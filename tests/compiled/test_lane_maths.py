"""Lane mathematics against mpmath, torch and itself on other numbers of lanes.

One kernel per number of lanes holds every function; a switch picks one.
"""

import functools
import re
import sys
from collections.abc import Callable
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
import torch
import warp as wp

from mann_torch.compiled.lanes.library import lane_library, lane_types

Points = np.ndarray
LANES = (8, pytest.param(2, marks=pytest.mark.slow), pytest.param(4, marks=pytest.mark.slow))

#: Name of a one-argument function -> the largest error allowed, in units in the last place.
UNARY = {
    "abs": 0.0, "sign": 0.0, "floor": 0.0, "ceil": 0.0, "trunc": 0.0, "round": 0.0, "sqrt": 0.501,
    "exp": 1.2, "exp2": 1.2, "expm1": 1.2, "log": 1.0, "log2": 1.0, "log10": 1.0, "log1p": 1.2,
    "sin": 1.6, "cos": 1.6, "tan": 1.2, "asin": 1.5, "acos": 1.5, "atan": 1.8,
    "sinh": 1.8, "cosh": 1.5, "tanh": 3.0, "asinh": 1.8, "acosh": 2.0, "atanh": 1.8,
    "sigmoid": 2.5, "erf": 1.5, "erfc": 2.0,
}  # fmt: skip
BINARY = {
    "max": 0.0, "min": 0.0, "fmod": 0.0, "remainder": 0.0, "copysign": 0.0,
    "atan2": 1.8, "pow": 1.2, "hypot": 1.2,
}  # fmt: skip
POWERS = (-3, -2, -1, 0, 1, 2, 3, 5, 12)
#: Functions of two V, and of two M, that yield an M.
COMPARISONS = ("lt", "le", "gt", "ge", "eq", "ne")
INTEGER = ("idiv", "imod", "imax", "imin", *(f"i{c}" for c in COMPARISONS), "mand", "mor", "mxor")
#: Text of the result by name, for a, b of type V and m, n with their bits as integers.
CASES = {
    **{name: f"r = Lanes::{name}_(a);" for name in UNARY},
    **{name: f"r = Lanes::{name}_(a, b);" for name in BINARY},
    **{f"powi{n}": f"r = Lanes::powi(a, {n});" for n in POWERS},
    **{name: f"r = Lanes::from_bits(Lanes::{name}(m, n));" for name in INTEGER},
    **{name: f"r = Lanes::from_bits(Lanes::{name}(a, b));" for name in COMPARISONS},
    "mnot": "r = Lanes::from_bits(Lanes::mnot(m));",
    "to_double": "r = Lanes::to_double(m);",
    "to_int": "r = Lanes::from_bits(Lanes::to_int(a));",
    "mask_to_double": "r = Lanes::mask_to_double(Lanes::lt(a, b));",
    "sel": "r = Lanes::sel(Lanes::lt(a, b), a, b);",
    "isel": "r = Lanes::from_bits(Lanes::isel(Lanes::ilt(m, n), m, n));",
    "fma": "r = Lanes::fma(a, b, a);",
    "any": "r = Lanes::splat(Lanes::any(Lanes::lt(a, b)) ? 1.0 : 0.0);",
    "all": "r = Lanes::splat(Lanes::all(Lanes::lt(a, b)) ? 1.0 : 0.0);",
    "get": "r = a; for (int k = 0; k < N; ++k) Lanes::put(&r, k, Lanes::get(b, N - 1 - k));",
    "iget": "for (int k = 0; k < N; ++k) Lanes::iput(&n, k, Lanes::iget(m, N - 1 - k));"
    " r = Lanes::from_bits(n);",
}
ACROSS = ("any", "all", "get", "iget")


def snippet(lanes: int, qualifier: str = "") -> str:
    cases = "".join(f"case {i}: {{ {text} break; }}\n" for i, text in enumerate(CASES.values()))
    return f"""{lane_types(lanes)}
struct Lanes {{
{lane_library(lanes, qualifier)}
}};
const int N = {lanes};
for (int i = 0; i < count; i += N) {{
  V a, b, r;
  memcpy(&a, x.data + i, sizeof(V));
  memcpy(&b, y.data + i, sizeof(V));
  M m = Lanes::bits(a), n = Lanes::bits(b);
  switch (which) {{ {cases} default: r = a; }}
  memcpy(out.data + i, &r, sizeof(V));
}}
"""


def kernel(lanes: int, qualifier: str = "") -> wp.Kernel:
    f64 = wp.array(dtype=wp.float64)

    @wp.func_native(snippet(lanes, qualifier))
    def apply(x: f64, y: f64, out: f64, count: int, which: int): ...

    @wp.kernel(module="unique", enable_backward=False)
    def run(x: f64, y: f64, out: f64, count: int, which: int):
        apply(x, y, out, count, which)

    return run


@functools.cache
def loaded(lanes: int) -> wp.Kernel:
    wp.config.log_level = wp.LOG_WARNING
    return kernel(lanes)


def call(name: str, x: Points, y: Points | None = None, lanes: int = 8) -> Points:
    """The function of every point; points are padded to whole groups."""
    count = len(x) + -len(x) % 8
    args = [np.ones(count), np.ones(count), np.empty(count)]
    args[0][: len(x)] = x
    args[1][: len(x)] = 1.0 if y is None else y
    arrays = [wp.array(a, dtype=wp.float64, device="cpu", copy=False) for a in args]
    wp.launch(loaded(lanes), 1, [*arrays, count, list(CASES).index(name)], device="cpu")
    return args[2][: len(x)]


def as_doubles(x: Points) -> Points:
    return x.astype(np.int64).view(np.float64)


def log_spaced(low: float, high: float, n: int, seed: int) -> Points:
    with np.errstate(over="ignore"):
        return np.exp2(np.random.default_rng(seed).uniform(low, high, n)).clip(0.0, 1.7e308)


def points(name: str, n: int) -> Points:
    """Points over the whole domain and where the function is delicate."""
    rng = np.random.default_rng(sum(map(ord, name)))
    signs = rng.choice([-1.0, 1.0], n)
    near_one = 1.0 + signs * log_spaced(-52, -1, n, 1)
    whole = log_spaced(-1074, 1023.9, n, 2)
    wide = [signs * whole, signs * log_spaced(-10, 5, n, 3), rng.uniform(-2, 2, n), near_one]
    if name in ("log", "log2", "log10", "sqrt"):
        return np.concatenate([whole, near_one, rng.uniform(0.3, 3, n), 10.0 ** np.arange(-9, 300)])
    if name == "log1p":
        return np.concatenate(
            [whole, signs * log_spaced(-1074, -1, n, 3), near_one[near_one > 1] - 2]
        )
    if name in ("asin", "acos", "atanh"):
        edge = signs * (1.0 - log_spaced(-53, -1, n, 3))
        return np.concatenate([signs * log_spaced(-1074, -1, n, 4), edge, rng.uniform(-1, 1, n)])
    if name == "acosh":
        return np.concatenate([1.0 + log_spaced(-52, 1, n, 3), 1.0 + whole, rng.uniform(1, 4, n)])
    if name in ("sin", "cos", "tan"):
        turns = rng.integers(-(2**29), 2**29, n) // (1 << rng.integers(0, 29, n))
        near = np.array([float(int(k) * mp.pi / 2) for k in turns])
        return np.concatenate([*wide, near, signs * log_spaced(20, 34, n, 4)])
    if name in ("round", "floor", "ceil", "trunc"):
        half = rng.integers(-50, 50, n) + 0.5
        return np.concatenate([*wide, half, np.nextafter(half, 0.0), signs * (2.0**52 + half)])
    if name in ("exp", "exp2", "expm1", "sinh", "cosh", "sigmoid"):
        low = -1075.0 if name == "exp2" else -746.0
        return np.concatenate(
            [*wide[1:], rng.uniform(low, -low - 36, n), rng.uniform(low, -708, n)]
        )
    if name in ("erf", "erfc"):
        return np.concatenate([*wide[1:], rng.uniform(-6, 28, n)])
    return np.concatenate(wide)


def pairs(name: str, n: int) -> tuple[Points, Points]:
    rng = np.random.default_rng(sum(map(ord, name)))
    if name == "pow":
        spread = np.concatenate([log_spaced(-1074, 1023.9, n, 1), 1 + log_spaced(-52, -1, n, 2)])
        x = np.concatenate([spread, 1 - log_spaced(-52, -1, n, 3), rng.uniform(0.1, 5, n)])
        with np.errstate(all="ignore"):
            y = rng.uniform(-745, 709, len(x)) / np.log(x)
        y[::3] = rng.uniform(-5, 5, len(y[::3]))
        return x, np.where(np.isfinite(y), y, 1.0)
    x = points("wide", n)
    ratio = log_spaced(-60, 60, len(x), 5).clip(None, 1e308 / np.abs(x).clip(1.0))
    y = x * ratio * rng.choice([-1.0, 1.0], len(x))
    y[::2] = rng.permutation(x)[::2]
    return x, y


def tiny_as_series(f: Callable[[mp.mpf], mp.mpf], cubic: mp.mpf) -> Callable[[mp.mpf], mp.mpf]:
    """mpmath's difference of exponentials or logarithms vanishes at tiny arguments."""
    return lambda x: f(x) if abs(x) > 1e-18 else x * (1 + cubic * x * x)


third = mp.mpf(1) / 3
EXACT: dict[str, Callable[..., mp.mpf]] = {
    "sqrt": mp.sqrt, "exp": mp.exp, "expm1": mp.expm1, "log": mp.log, "log1p": mp.log1p,
    "exp2": lambda x: mp.mpf(2) ** x, "log2": lambda x: mp.log(x) / mp.log(2),
    "log10": lambda x: mp.log(x) / mp.log(10), "sin": mp.sin, "cos": mp.cos, "tan": mp.tan,
    "asin": tiny_as_series(mp.asin, third / 2), "acos": mp.acos,
    "atan": tiny_as_series(mp.atan, -third), "sinh": tiny_as_series(mp.sinh, third / 2),
    "cosh": mp.cosh, "tanh": tiny_as_series(mp.tanh, -third),
    "asinh": tiny_as_series(mp.asinh, -third / 2), "acosh": mp.acosh,
    "atanh": tiny_as_series(mp.atanh, third), "sigmoid": lambda x: 1 / (1 + mp.exp(-x)),
    "erf": mp.erf, "erfc": mp.erfc, "pow": mp.power, "atan2": mp.atan2,
    "hypot": lambda x, y: mp.sqrt(x * x + y * y),
}  # fmt: skip


def error(got: float, exact: mp.mpf) -> float:
    """|got - exact| in units of the last place of `exact`."""
    if abs(exact) >= mp.mpf(2) ** 1024 * (1 - mp.mpf(2) ** -54):
        return 0.0 if np.isinf(got) and (got > 0) == (exact > 0) else np.inf
    if not np.isfinite(got):
        return np.inf
    exponent = -1022 if exact == 0 else max(mp.mag(exact) - 1, -1022)
    return float(abs(mp.mpf(got) - exact) * mp.mpf(2) ** (52 - exponent))


@pytest.mark.parametrize("name", EXACT)
def test_error_against_mpmath(name: str) -> None:
    args = pairs(name, 300) if name in BINARY else (points(name, 300),)
    with mp.workdps(60):
        exact = [EXACT[name](*map(mp.mpf, numbers)) for numbers in zip(*args, strict=True)]
        errors = [error(float(g), e) for g, e in zip(call(name, *args), exact, strict=True)]
    worst = int(np.argmax(errors))
    where = [float(a[worst]).hex() for a in args]
    assert errors[worst] <= {**UNARY, **BINARY}[name], f"{errors[worst]:.3f} ulp at {where}"


def in_torch(name: str) -> Callable[..., torch.Tensor]:
    names = {"max": "maximum", "min": "minimum", "sigmoid": "sigmoid"}
    return getattr(torch, names.get(name, name))


def distance(a: Points, b: Points, signs: bool = True) -> Points:
    """In units in the last place; infinite where NaN, infinity or a zero's sign differ."""
    with np.errstate(all="ignore"):
        ulp = np.abs(a - b) / np.spacing(np.abs(b))
    ulp = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, ulp)
    ulp = np.where((np.isnan(a) != np.isnan(b)) | (np.isinf(a) & (a != b)), np.inf, ulp)
    wrong_sign = (a == 0) & (b == 0) & (np.signbit(a) != np.signbit(b)) & signs
    return np.where(wrong_sign, np.inf, ulp)


@pytest.mark.parametrize("name", [n for n in (*UNARY, *BINARY) if n not in ("fmod", "remainder")])
def test_many_points_against_torch(name: str) -> None:
    args = pairs(name, 4000) if name in BINARY else (points(name, 4000),)
    if name in ("sinh", "cosh"):  # torch overflows before its result does
        args = (args[0].clip(-709, 709),)
    if name == "sigmoid":  # torch rounds to 0 what is denormal
        args = (args[0].clip(-708, None),)
    expected = in_torch(name)(*map(torch.from_numpy, args)).numpy()
    limit = {**UNARY, **BINARY}[name]
    apart = distance(call(name, *args), expected)
    worst = int(np.argmax(apart))
    # torch is itself off by one place or so.
    assert apart[worst] <= (limit and limit + 1.6), (float(apart[worst]), [a[worst] for a in args])


def test_fmod_and_remainder_are_exact() -> None:
    x, y = pairs("fmod", 4000)
    y[:50], x[50:100] = 0.0, 0.0
    with np.errstate(all="ignore"):
        expected = np.fmod(x, y)
        assert distance(call("fmod", x, y), expected).max() == 0.0
        turned = (expected != 0) & ((y < 0) != (expected < 0))
        expected = np.where(turned, expected + y, expected)
    assert distance(call("remainder", x, y), expected).max() == 0.0


NORMAL = np.finfo(np.float64)
POSITIVE = np.array([
    0.0, np.inf, 1.0, 0.5, 1.5, 2.0, 2.5, 3.0, 1e-310, 5e-324, NORMAL.smallest_normal, NORMAL.max,
    709.0, 711.0, 746.0, 1075.0, 1e22, 4503599627370497.5,
])  # fmt: skip
SPECIAL = np.concatenate([POSITIVE, -POSITIVE, [np.nan]])


@pytest.mark.parametrize("name", (*UNARY, *BINARY))
def test_special_values_are_those_of_torch(name: str) -> None:
    x, y = (a.ravel() for a in np.meshgrid(SPECIAL, SPECIAL))
    args = (x, y) if name in BINARY else (SPECIAL,)
    expected = in_torch(name)(*map(torch.from_numpy, args)).numpy()
    apart = distance(call(name, *args), expected, signs=name not in ("max", "min"))
    if name == "sigmoid":
        apart[SPECIAL == -711.0] = 0.0
    if name in ("fmod", "remainder"):  # torch has NaN for some quotients beyond 1e308
        apart[np.isnan(expected) & np.isfinite(x) & (y != 0)] = 0.0
    limit = {**UNARY, **BINARY}[name]
    worst = int(np.argmax(apart))
    found = [float(a[worst]) for a in (*args, call(name, *args), expected)]
    assert apart[worst] <= (limit and limit + 1.0), found


@pytest.mark.parametrize("n", POWERS)
def test_integer_powers(n: int) -> None:
    x = np.concatenate([log_spaced(-80, 80, 500, 0), -log_spaced(-80, 80, 500, 1), SPECIAL])
    expected = torch.from_numpy(x).pow(n).numpy()
    got = call(f"powi{n}", x)
    far = (np.abs(expected) < 1e-300) & (expected != 0)  # 1 / x^n where x^n overflows
    assert distance(got, expected)[~far].max() <= (abs(n) if abs(n) > 2 else abs(n) // 2)


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("name", [name for name in CASES if name not in ACROSS])
def test_bits_depend_on_no_other_lane_and_on_no_number_of_lanes(name: str, lanes: int) -> None:
    args = pairs(name, 300) if name in BINARY else (points(name, 300), points(name, 300)[::-1])
    x, y = (np.concatenate([a, SPECIAL]) for a in args)
    got, one = call(name, x, y, lanes), call(name, x, y, 1)
    nan = np.isnan(got) & np.isnan(one)
    if name in (*UNARY, *BINARY) or name.startswith("powi"):  # a NaN's payload means nothing
        got, one = np.where(nan, 0.0, got), np.where(nan, 0.0, one)
    assert np.array_equal(got.view(np.int64), one.view(np.int64))


@pytest.mark.parametrize("lanes", (1, *LANES))
def test_integers(lanes: int) -> None:
    rng = np.random.default_rng(0)
    edge = [0, 1, -1, 2, 7, -7, 2**62, -(2**62), 2**63 - 1, -(2**63)]
    m, n = (a.ravel() for a in np.meshgrid(np.array(edge), np.array(edge)))
    m = np.concatenate([m, rng.integers(-50, 50, 400), rng.integers(-(2**62), 2**62, 400)])
    n = np.concatenate([n, rng.integers(-9, 9, 400), rng.integers(-(2**40), 2**40, 400)])
    a, b = torch.from_numpy(m), torch.from_numpy(n)

    def got(name: str) -> torch.Tensor:
        return torch.from_numpy(call(name, as_doubles(m), as_doubles(n), lanes).view(np.int64))

    # Zero divides like one; the smallest integer has no opposite.
    d = torch.where((b == 0) | (b == -1), 1, b)
    quotient = torch.where(b == -1, -a, torch.div(a, d, rounding_mode="floor"))
    assert torch.equal(got("idiv"), quotient)
    assert torch.equal(got("imod"), torch.remainder(a, d))
    assert torch.equal(got("imax"), torch.maximum(a, b))
    assert torch.equal(got("imin"), torch.minimum(a, b))
    for name in COMPARISONS:
        assert torch.equal(got(f"i{name}"), -getattr(torch, name)(a, b).long())
    assert torch.equal(got("mand"), a & b) and torch.equal(got("mor"), a | b)
    assert torch.equal(got("mxor"), a ^ b) and torch.equal(got("mnot"), ~a)
    assert torch.equal(got("isel"), torch.minimum(a, b))
    assert torch.equal(got("to_double").view(torch.float64), a.double())


@pytest.mark.parametrize("lanes", (1, *LANES))
def test_primitives_on_doubles(lanes: int) -> None:
    x, y = (a.ravel() for a in np.meshgrid(SPECIAL, SPECIAL))
    x, y = x[: len(x) // 8 * 8], y[: len(y) // 8 * 8]
    a, b = torch.from_numpy(x), torch.from_numpy(y)
    for name in COMPARISONS:
        mask = torch.from_numpy(call(name, x, y, lanes).view(np.int64))
        assert torch.equal(mask, -getattr(torch, name)(a, b).long())
    less = a < b
    chosen = torch.where(less, a, b).numpy()
    assert np.array_equal(call("sel", x, y, lanes).view(np.int64), chosen.view(np.int64))
    assert np.array_equal(call("mask_to_double", x, y, lanes), less.double().numpy())
    groups = less.reshape(-1, lanes)
    for name, found in (("any", groups.any(1)), ("all", groups.all(1))):
        expected = found.double().repeat_interleave(lanes).numpy()
        assert np.array_equal(call(name, x, y, lanes), expected)
    for name, source in (("get", y), ("iget", x)):
        expected = source.reshape(-1, lanes)[:, ::-1].ravel()
        found = call(name, x, y, lanes)
        assert np.array_equal(found.view(np.int64), expected.view(np.int64))
    whole = [0.0, -0.0, 1.5, -1.5, 1e18, -1e18, -(2.0**63), 2.0**63, np.inf, -np.inf, np.nan]
    expected = [int(v) if abs(v) < 2**63 else -(2**63) for v in whole]
    assert call("to_int", np.array(whole), None, lanes).view(np.int64).tolist() == expected
    fused = call("fma", np.array([1.0 + 2.0**-52]), np.array([-1.0 + 2.0**-52]), lanes)
    assert fused[0] == 2.0**-52 + 2.0**-104


def test_sine_and_cosine_keep_within_one() -> None:
    x = np.random.default_rng(0).uniform(-1e6, 1e6, 200_000)
    assert max(np.abs(call("sin", x)).max(), np.abs(call("cos", x)).max()) <= 1.0


def test_the_text() -> None:
    with pytest.raises(ValueError, match="lanes must be one of"):
        lane_library(3)
    with pytest.raises(ValueError, match="lanes must be one of"):
        lane_types(32)
    text = lane_library(8, "QUALIFIER")
    assert not re.search(r"@|^(fn|slow) ", text, flags=re.MULTILINE)
    assert text.count("static inline") == text.count("QUALIFIER static inline")


@pytest.mark.skipif(sys.platform == "darwin", reason="Warp has no CUDA there")
def test_one_lane_compiles_for_cuda_too(tmp_path: Path) -> None:
    wp.init()
    module = kernel(1, "CUDA_CALLABLE").module
    wp.compile_aot_module(module, module_dir=tmp_path, arch=80, use_ptx=True)
    assert list(tmp_path.glob("*.ptx"))
