"""Steps in C99 against the compiled kernels, and what C99 cannot say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from mann_torch.compiled import Layout, Leaf, Program
from mann_torch.compiled.c99 import c99_file, c99_function, c99_literals, constants_in
from mann_torch.compiled.c99.library import WHOLE
from mann_torch.errors import ExportError

from .c99_building import FMA, NO_FMA, X86, compiled, loaded, pointer
from .marching import Inputs, Together, difference
from .random_graphs import inputs, random_graph

ARRAYS = ("constant", "segment", "whole", "f", "k", "f_out", "k_out")


def entry(program: Program, prefix: str, baked: bool = False) -> str:
    """A function of that name that other files can call."""
    kinds = {"f": program.layout.real.name, "i": WHOLE[program.layout.real.bytes]}
    taken = [a for a in ARRAYS if not baked or a not in ("constant", "whole")]
    parameters = ", ".join(
        f"{'' if a.endswith('_out') else 'const '}{kinds['i' if a[0] in 'kw' else 'f']}* {a}"
        for a in taken
    )
    head = f"void {prefix}run({parameters})"
    return f"{head};\n{head} {{ {prefix}step({', '.join(taken)}); }}\n"


def together(number: int, count: int, single: bool) -> tuple[Together, Inputs]:
    given = inputs(count, seed=number)
    given = given.single() if single else given
    graphs = dict(random_graph(50 * number + i, given.sample(i)) for i in range(count))
    return Together(list(graphs.values()), given), given


def arrays(made: Together, given: Inputs, row: int) -> dict[str, np.ndarray]:
    """The arrays of one sample."""
    layout, real = made.program.layout, made.program.layout.real
    constant, whole = constants_in(
        made.program.given, [value[row] for value in given.constants.values()]
    )
    f = torch.zeros(layout.size("f"), dtype=real.dtype)
    places = layout.carry_places[len(made.results) :]
    for (array, offset), value in zip(places, given.carried.values(), strict=True):
        assert array == "f"
        f[offset : offset + value[row].numel()] = value[row].reshape(-1)
    k = torch.zeros(layout.size("k"), dtype=real.whole_dtype)
    found = [constant.to(real.dtype), f[:0], whole.to(real.whole_dtype), f, k]
    found += [torch.full_like(f, 7.0), torch.full_like(k, 7)]
    return {name: x.numpy() for name, x in zip(ARRAYS, found, strict=True)}


@pytest.mark.parametrize(
    ("number", "count", "single", "compiler"),
    [(0, 20, False, "gcc"), (0, 8, True, "gcc"),
     *(pytest.param(n, 50, s, c, marks=pytest.mark.slow)
       for n in (1, 2, 3) for s in (False, True) for c in ("gcc", "clang"))],
)  # fmt: skip
def test_random_graphs_are_those_of_the_kernels(
    number: int, count: int, single: bool, compiler: str, tmp_path: Path
) -> None:
    made, given = together(number, count, single)
    real = made.program.layout.real
    expected = made.run(given)
    text = c99_file([c99_function(made.program, "p_step")], "p_") + entry(made.program, "p_")
    for flags in (FMA, NO_FMA) if X86 else ((),):
        library = loaded(compiled(text, tmp_path, compiler, *flags), compiler)
        for row in range(min(count, 5)):
            own = arrays(made, given, row)
            library.p_run(*map(pointer, own.values()))
            f, k = (torch.from_numpy(own[name]) for name in ("f_out", "k_out"))
            if flags == FMA:
                assert torch.equal(f.nan_to_num(7.0), expected[0][row].nan_to_num(7.0))
            limit = 1e-15 if real.bytes == 8 else 1e-6
            start = 0
            for result in made.results:
                end = start + result.numel() * result.is_floating_point()
                assert difference(f[start:end], expected[0][row, start:end]) <= 8 * limit
                start = end
            assert torch.equal(k.long(), expected[1][row])


def test_constants_in_the_text_are_those_that_are_given(tmp_path: Path) -> None:
    made, given = together(0, 6, False)
    row, real = 2, made.program.layout.real
    own = arrays(made, given, row)
    text = c99_file([c99_function(made.program, "a_step")], "a_") + entry(made.program, "a_")
    text += c99_literals("b_constant", torch.from_numpy(own["constant"]), real)
    text += c99_literals("b_whole", torch.from_numpy(own["whole"]), real)
    unit = c99_function(made.program, "b_step", baked="b_")
    text += c99_file([unit], "b_") + entry(made.program, "b_", baked=True)
    library = loaded(compiled(text, tmp_path))  # two in one file: no name is taken twice
    library.a_run(*map(pointer, own.values()))
    first = own["f_out"].copy()
    own["f_out"][:] = 0
    library.b_run(*(pointer(x) for name, x in own.items() if name not in ("constant", "whole")))
    assert np.array_equal(first, own["f_out"], equal_nan=True)


def program_of(step, noise=(), clock=0, width=3) -> Program:
    layout = Layout(
        clock=clock, constants=(), segments=(), noise=noise, carry=(Leaf((width,)),),
        n_motion=0, watched=(),
    )  # fmt: skip
    one = torch.ones((), dtype=torch.float64)
    examples = [one] * clock + [torch.ones(n, dtype=torch.float64) for n in noise]
    return Program(step, layout, [*examples, torch.ones(width, dtype=torch.float64)])


def noisy(given) -> list[Tensor]:
    return [given.carry[0] + given.noise[0]]


def timed(given) -> list[Tensor]:
    return [given.carry[0] + given.clock[0]]


def large(given) -> list[Tensor]:
    x = given.carry[0]
    A = torch.outer(x, x)
    return [torch.linalg.solve(A + torch.eye(len(A), dtype=A.dtype), x)]


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (lambda: program_of(noisy, noise=((3,),)), "random numbers"),
        (lambda: program_of(timed, clock=1), "the time"),
        (lambda: program_of(large, width=200), "KiB"),
    ],
)
def test_what_c_cannot_say_is_refused_in_a_line(program, words: str) -> None:
    with pytest.raises(ExportError, match=words) as found:
        c99_function(program(), "step")
    assert "\n" not in str(found.value) and "step" in str(found.value)


def test_the_smallest_integer_has_a_text(tmp_path: Path) -> None:
    def step(given) -> list[Tensor]:
        (x,) = given.carry
        return [torch.where(torch.tensor([-(2**63), 2**63 - 1]) < 0, x, -x)]

    layout = Layout(0, (), (), (), (Leaf((2,), "i"),), 0, ())
    program = Program(step, layout, [torch.tensor([5, 6])])
    text = c99_file([c99_function(program, "p_step")], "p_") + entry(program, "p_")
    none, k = np.zeros(0), np.array([-(2**63), -(2**63)])
    out = np.zeros(2, np.int64)
    run = loaded(compiled(text, tmp_path)).p_run
    run(*map(pointer, (none, none, none, none, k, none, out)))
    assert out.tolist() == [-(2**63), -(2**63)]  # it wraps, as torch's does
