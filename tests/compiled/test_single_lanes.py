"""Lane mathematics in float32 against torch's in float64, and itself on other numbers of lanes."""

import functools

import numpy as np
import pytest
import torch
import warp as wp

from mann_torch.compiled.lanes.library import lane_library, lane_types
from mann_torch.compiled.real import FLOAT

Points = np.ndarray
#: Name of a one-argument function -> the largest error allowed, in units in the last place.
OWN = {"exp": 1.1, "expm1": 1.2, "log": 1.0, "tanh": 1.6, "sigmoid": 2.0}
WIDE = """
    exp2 log2 log10 log1p sin cos tan asin acos atan sinh cosh asinh acosh atanh erf erfc sqrt
"""
EXACT = ("abs", "sign", "floor", "ceil", "trunc", "round")
LIMITS = {**OWN, **dict.fromkeys(WIDE.split(), 0.501), **dict.fromkeys(EXACT, 0.0)}
TWO = {"atan2": 0.501, "pow": 0.501, "hypot": 0.501, "fmod": 0.0, "max": 0.0, "min": 0.0}
CASES = {
    **{name: f"r = Lanes::{name}_(a);" for name in LIMITS},
    **{name: f"r = Lanes::{name}_(a, b);" for name in (*TWO, "remainder", "copysign")},
    "fma": "r = Lanes::fma(a, b, a);",
    "powi": "r = Lanes::powi(a, 5) + Lanes::powi(b, -2);",
    "sel": "r = Lanes::sel(Lanes::lt(a, b), a, b);",
    "to_int": "r = Lanes::to_double(Lanes::to_int(a));",
    "mask": "r = Lanes::mask_to_double(Lanes::ge(a, b));",
    "idiv": "r = Lanes::from_bits(Lanes::idiv(m, n) ^ Lanes::imod(n, m));",
}
LANES = (16, pytest.param(4, marks=pytest.mark.slow), pytest.param(8, marks=pytest.mark.slow))


@functools.cache
def kernel(lanes: int) -> wp.Kernel:
    wp.config.log_level = wp.LOG_WARNING
    cases = "".join(f"case {i}: {{ {text} break; }}\n" for i, text in enumerate(CASES.values()))
    text = f"""{lane_types(lanes, FLOAT)}
struct Lanes {{
{lane_library(lanes, real=FLOAT)}
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
    f32 = wp.array(dtype=wp.float32)

    @wp.func_native(text)
    def apply(x: f32, y: f32, out: f32, count: int, which: int): ...

    @wp.kernel(module="unique", enable_backward=False)
    def run(x: f32, y: f32, out: f32, count: int, which: int):
        apply(x, y, out, count, which)

    return run


def call(name: str, x: Points, y: Points | None = None, lanes: int = 16) -> Points:
    """The function of every point; points are padded to whole groups."""
    count = len(x) + -len(x) % 16
    args = [np.ones(count, np.float32) for _ in range(3)]
    args[0][: len(x)] = x
    args[1][: len(x)] = 1.0 if y is None else y
    arrays = [wp.array(a, dtype=wp.float32, device="cpu", copy=False) for a in args]
    wp.launch(kernel(lanes), 1, [*arrays, count, list(CASES).index(name)], device="cpu")
    return args[2][: len(x)]


def points() -> Points:
    """A part of all float32 numbers, of every size and both signs, infinite and none too."""
    bits = np.random.default_rng(0).integers(0, 2**32, 40_000, dtype=np.uint32)
    near = np.random.default_rng(1).uniform(-20.0, 20.0, 40_000)
    small = np.random.default_rng(2).uniform(-1.0, 1.0, 20_000)
    edge = [0.0, -0.0, 1.0, -1.0, 0.5, 88.8, -87.4, -104.0, np.inf, -np.inf, np.nan, 1e-45, 2.5]
    return np.concatenate([bits.view(np.float32), near, small, edge]).astype(np.float32)


def exact(name: str, *args: Points) -> Points:
    names = {"max": "maximum", "min": "minimum"}
    function = getattr(torch, names.get(name, name))
    return function(*(torch.from_numpy(a.astype(np.float64)) for a in args)).numpy()


def error(got: Points, expected: Points) -> float:
    """Largest error in units in the last place of float32; inf for another infinity or NaN."""
    with np.errstate(all="ignore"):
        held = expected.astype(np.float32)
        unit = np.spacing(np.abs(held)).astype(np.float64)
        apart = np.abs(got.astype(np.float64) - expected) / unit
    edge = ~np.isfinite(held)
    same = (got == held) | (np.isnan(got) & np.isnan(held))
    return float(np.where(edge | same, np.where(edge & ~same, np.inf, 0.0), apart).max())


@pytest.mark.parametrize("name", LIMITS)
def test_error_of_one_argument(name: str) -> None:
    x = points()
    # torch's own sine of a large number is one of float64: the same float32 number.
    assert error(call(name, x), exact(name, x)) <= LIMITS[name]


@pytest.mark.parametrize("name", TWO)
def test_error_of_two_arguments(name: str) -> None:
    x = points()
    y = np.random.default_rng(3).permutation(x)
    if name == "pow":
        x, y = np.abs(x), (y % 7.0).astype(np.float32)
    assert error(call(name, x, y), exact(name, x, y)) <= TWO[name]


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("name", CASES)
def test_bits_depend_on_no_other_lane_and_on_no_number_of_lanes(name: str, lanes: int) -> None:
    x = points()[::11]
    y = x[::-1].copy()
    got, one = call(name, x, y, lanes), call(name, x, y, 1)
    nan = np.isnan(got) & np.isnan(one)  # a NaN's payload means nothing
    got, one = np.where(nan, 0, got), np.where(nan, 0, one)
    assert np.array_equal(got.view(np.int32), one.view(np.int32))
