"""Elementary functions in C99, with fma and without, with <math.h> and without."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest

from mann_torch.compiled.c99 import CUnit, c99_file
from mann_torch.compiled.c99.library import functions, library, named
from mann_torch.compiled.real import DOUBLE, FLOAT, Real

from . import test_lane_maths as lanes
from . import test_single_lanes as single_lanes
from .c99_building import FMA, NO_FMA, X86, compiled, loaded, pointer, run_sanitized, undefined

Points = np.ndarray
NAMES = (*lanes.UNARY, *lanes.BINARY)
#: Errors of a machine without fma beyond those of one with it, in units in the last place.
MORE = 1.0
only_x86 = pytest.mark.skipif(not X86, reason="no flag takes fma from this machine")


def unit(real: Real) -> CUnit:
    """A function over arrays of each function of the library."""
    lines = []
    for name in NAMES:
        head = f"void call_{name}(const V* x, const V* y, V* out, int n)"
        rest = "" if name in lanes.BINARY else "(void)y; "
        value = f"{name}_(x[i], y[i])" if name in lanes.BINARY else f"{name}_(x[i])"
        lines.append(f"{head};\n{head} {{ {rest}for (int i = 0; i < n; ++i) out[i] = {value}; }}")
    text = "\n".join(lines)
    return CUnit(real, text)


def apply(library: ctypes.CDLL, name: str, *args: Points) -> Points:
    x, y = (np.ascontiguousarray(a) for a in (args[0], args[-1]))
    out = np.empty_like(x)
    getattr(library, f"call_{name}")(pointer(x), pointer(y), pointer(out), len(x))
    return out


def arguments(name: str) -> tuple[Points, ...]:
    if name in lanes.BINARY:
        return lanes.pairs(name, 1500)
    x = lanes.points(name, 1500)
    if name in ("sinh", "cosh"):  # torch overflows before its result does
        x = x.clip(-709, 709)
    return (x.clip(-708, None),) if name == "sigmoid" else (x,)


def beyond(name: str, *args: Points) -> Points:
    """Where the short reduction does not reach."""
    if name in ("sin", "cos", "tan"):
        return np.abs(args[0]) > 1e9
    if name in ("fmod", "remainder"):
        with np.errstate(all="ignore"):
            return ~(np.abs(args[0] / args[1]) < 2.0**52)
    return np.zeros(len(args[0]), bool)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("compiler", "libm", "dialect"),
    [("gcc", False, "c99"), *(pytest.param(*c, marks=SLOW) for c in
     (("gcc", True, "c99"), ("clang", False, "c99"), ("clang", True, "c99"),
      ("gcc", True, "gnu11"), ("clang", True, "gnu11")))],
)  # fmt: skip
def test_with_fma_the_bits_are_those_of_the_lanes(
    compiler: str, libm: bool, dialect: str, tmp_path: Path
) -> None:
    text = c99_file([unit(DOUBLE)], "p_", libm=libm)
    # In their own dialects compilers contract, unless the text forbids it.
    strict = dialect == "c99"
    made = compiled(text, tmp_path, compiler, f"-std={dialect}", *FMA, strict=strict)
    library = loaded(made, compiler)
    for name in NAMES:
        args = (*lanes.pairs(name, 500), lanes.SPECIAL) if name in lanes.BINARY else ()
        args = tuple(
            np.concatenate([a, lanes.SPECIAL])
            for a in (args[:2] if args else (lanes.points(name, 500),))
        )
        got, expected = apply(library, name, *args), lanes.call(name, *args)
        far = np.zeros(len(got), bool) if libm else beyond(name, *args)
        nan = np.isnan(got) & np.isnan(expected)
        same = (got.view(np.int64) == expected.view(np.int64)) | nan
        assert (same | far).all(), (name, [a[~(same | far)][0] for a in args])
        assert libm or np.isnan(got[far]).all()


@only_x86
@pytest.mark.parametrize(
    ("compiler", "libm"),
    [("gcc", True), *(pytest.param(*c, marks=pytest.mark.slow) for c in
                      (("gcc", False), ("clang", False), ("clang", True)))],
)  # fmt: skip
def test_without_fma_the_errors_grow_by_no_more_than_one(
    compiler: str, libm: bool, tmp_path: Path
) -> None:
    made = compiled(c99_file([unit(DOUBLE)], "p_", libm=libm), tmp_path, compiler, *NO_FMA)
    library = loaded(made, compiler)
    exact = {n for n, limit in {**lanes.UNARY, **lanes.BINARY}.items() if not limit} | {"sqrt"}
    for name in NAMES:
        args = arguments(name)
        expected = lanes.call(name, *args)
        apart = lanes.distance(apply(library, name, *args), expected)
        if not libm:
            apart = apart[~beyond(name, *args)]
        # Two places lie between results that err by MORE on either side of a number.
        assert apart.max() <= (0.0 if name in exact else 2 * MORE), name


@pytest.mark.parametrize("flags", [FMA, pytest.param(NO_FMA, marks=only_x86)])
def test_square_roots_without_a_library_are_rounded_correctly(
    flags: tuple[str, ...], tmp_path: Path
) -> None:
    text = "void roots(const V* x, V* out, int n);\n"
    text += "void roots(const V* x, V* out, int n) { for (int i = 0; i < n; ++i) "
    text += "out[i] = sqrt_(x[i]); }"
    made = CUnit(DOUBLE, text)
    object_file = compiled(c99_file([made], "p_", libm=False), tmp_path, "gcc", *flags)
    assert undefined(object_file) == set()
    bits = np.random.default_rng(0).integers(0, 2**63, 200_000)
    exact = np.random.default_rng(1).integers(0, 2**26, 1000).astype(np.float64) ** 2
    near = np.concatenate([np.nextafter(exact, 0.0), exact, np.nextafter(exact, np.inf)])
    edge = np.nextafter([1.0, 4.0, 4.0, 1.0], [0.0, 0.0, 9.0, 9.0])
    x = np.concatenate([bits.view(np.float64), near, edge, -near, lanes.SPECIAL])
    out = np.empty_like(x)
    loaded(object_file).roots(pointer(x), pointer(out), len(x))
    with np.errstate(invalid="ignore"):
        expected = np.sqrt(x)
    assert ((out == expected) | (np.isnan(out) & np.isnan(expected))).all()
    assert (np.signbit(out) == np.signbit(expected))[~np.isnan(expected)].all()


@pytest.mark.parametrize("real", [DOUBLE, FLOAT])
@pytest.mark.parametrize("flags", [FMA, pytest.param(NO_FMA, marks=only_x86)])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.slow
def test_nothing_is_linked_without_a_library(
    real: Real, flags: tuple[str, ...], compiler: str, tmp_path: Path
) -> None:
    text = c99_file([unit(real)], "p_", libm=False)
    assert undefined(compiled(text, tmp_path, compiler, *flags)) == set()


@pytest.mark.slow
@pytest.mark.parametrize("real", [DOUBLE, FLOAT])
@pytest.mark.parametrize("flags", [FMA, pytest.param(NO_FMA, marks=only_x86)])
@pytest.mark.parametrize("libm", [True, False])
def test_no_function_brings_one_that_is_not_called(
    real: Real, flags: tuple[str, ...], libm: bool, tmp_path: Path
) -> None:
    """Each with what it calls and nothing else, under clang, which warns of the unused."""
    parts = []
    for i, name in enumerate(functions(real, libm)):
        prefix = f"p{i}_"
        call = named(f"void p{i}(void) {{ (void)&{name}(); }}", real, prefix).replace("();", ";")
        if flags == FMA:
            parts += [f"#define P{i}_HAVE_FMA{end} 1" for end in ("", "F")]
        parts += [f"void p{i}(void);", library([name], real, libm, prefix), call]
    head = c99_file([CUnit(real, "")], "p_", libm)
    compiled(head + "\n".join(parts) + "\n", tmp_path, "clang", "-fsyntax-only", *flags)


@pytest.mark.slow
@pytest.mark.parametrize("libm", [True, False])
@pytest.mark.parametrize("flags", [FMA, pytest.param(NO_FMA, marks=only_x86)])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_float32(compiler: str, flags: tuple[str, ...], libm: bool, tmp_path: Path) -> None:
    library = loaded(compiled(c99_file([unit(FLOAT)], "p_", libm=libm), tmp_path, compiler, *flags))
    limits = {**single_lanes.LIMITS, **single_lanes.TWO}
    more = 0.0 if flags == FMA else 0.6
    for name, limit in limits.items():
        x = single_lanes.points()
        y = np.random.default_rng(3).permutation(x)
        if name == "pow":
            x, y = np.abs(x), (y % 7.0).astype(np.float32)
        args = (x, y) if name in single_lanes.TWO else (x,)
        near = np.ones(len(x), bool)
        if not libm:
            near = ~beyond(name, *(a.astype(np.float64) for a in args))
        args = tuple(a[near] for a in args)
        own = more if name in single_lanes.OWN else 0.0
        found = single_lanes.error(apply(library, name, *args), single_lanes.exact(name, *args))
        assert found <= limit + own, name


@pytest.mark.slow
@pytest.mark.parametrize("real", [DOUBLE, FLOAT])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_no_number_leads_to_undefined_behaviour(real: Real, compiler: str, tmp_path: Path) -> None:
    """Any bits at all, under the sanitizers."""
    kind = real.name
    loop = "\n".join(f"  call_{name}(x, y, out, N); for (int i = 0; i < N; ++i) "
                     "sum += out[i] == out[i];" for name in NAMES)  # fmt: skip
    text = (
        c99_file([unit(real)], "p_", libm=False)
        + f"""
#include <stdio.h>
enum {{ N = 20000 }};
int main(void) {{
  static {kind} x[N], y[N], out[N];
  FILE* file = fopen("{tmp_path}/bits", "rb");
  if (!file || fread(x, sizeof x, 1, file) != 1 || fread(y, sizeof y, 1, file) != 1) return 1;
  fclose(file);
  long sum = 0;
{loop}
  printf("%ld\\n", sum);
  return 0;
}}
"""
    )
    bits = np.random.default_rng(0).integers(0, 2**63, (2, 20000)).astype(f"u{real.bytes}") * 3
    bits[:, : len(lanes.SPECIAL)] = lanes.SPECIAL.astype(f"f{real.bytes}").view(f"u{real.bytes}")
    bits.tofile(tmp_path / "bits")
    run_sanitized(text, tmp_path, compiler)
