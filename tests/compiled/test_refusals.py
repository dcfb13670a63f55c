"""What cannot be compiled is refused by name, with the line it stands in; never baked in."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from mann_torch.compiled import UntraceableError

from .marching import Inputs, Together, check_together

Sample = dict[str, Tensor]
TABLE = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
ROWS = torch.tensor([0, 2])


class Captor(nn.Module):
    """Holds a tensor that is neither parameter nor buffer."""

    def __init__(self) -> None:
        super().__init__()
        self.gain = torch.ones(3, dtype=torch.float64)

    def forward(self, x: Tensor) -> Tensor:
        return self.gain * x


captor = Captor()


def inputs() -> Inputs:
    g = torch.Generator().manual_seed(0)
    v = torch.randn(2, 3, generator=g, dtype=torch.float64)
    m = torch.randn(2, 3, 3, generator=g, dtype=torch.float64)
    return Inputs(
        {"v": v, "m": m @ m.mT, "n": v > 0}, {"s": v[:, 0].clone(), "k": torch.tensor([1, 2])}
    )


def random_numbers(s: Sample) -> Tensor:
    return s["v"] * torch.rand(3, dtype=torch.float64)


def random_like(s: Sample) -> Tensor:
    return s["v"] + torch.randn_like(s["v"])


def dropout(s: Sample) -> Tensor:
    return torch.nn.functional.dropout(s["v"], 0.5)


def eigenvalues(s: Sample) -> Tensor:
    return torch.linalg.eigvalsh(s["m"])


def eigenvectors(s: Sample) -> Tensor:
    return torch.linalg.eigh(s["m"])[1]


def singular_values(s: Sample) -> Tensor:
    return torch.linalg.svdvals(s["m"])


def item(s: Sample) -> Tensor:
    return s["v"] * s["s"].item()


def number(s: Sample) -> Tensor:
    return s["v"] * float(s["s"])


def listed(s: Sample) -> Tensor:
    return s["v"] * s["v"].tolist()[0]


def branch(s: Sample) -> Tensor:
    if s["s"] > 0:
        return s["v"]
    return -s["v"]


def loop(s: Sample) -> Tensor:
    x = s["s"]
    while x < 3:
        x = x + 1
    return x


def mask(s: Sample) -> Tensor:
    return s["v"][s["n"]].sum()


def some_of_them(s: Sample) -> Tensor:
    x = s["v"].clone()
    x[s["n"]] *= 2
    return x


def single(s: Sample) -> Tensor:
    return (s["v"].float() * 2).double()


def single_from_whole(s: Sample) -> Tensor:
    return s["v"] * (s["k"] / 3)


def half(s: Sample) -> Tensor:
    return s["v"].half().double()


def bytes_that_wrap(s: Sample) -> Tensor:
    return (s["k"].to(torch.uint8) * 200).long()


def complex_numbers(s: Sample) -> Tensor:
    return torch.complex(s["v"], s["v"]).abs()


def spectrum(s: Sample) -> Tensor:
    return torch.fft.rfft(s["v"]).abs()


def captured(s: Sample) -> Tensor:
    return s["v"] * TABLE


def captured_rows(s: Sample) -> Tensor:
    return s["v"][ROWS]


def captured_by_a_module(s: Sample) -> Tensor:
    return captor(s["v"])


def captured_twice(s: Sample) -> Tensor:
    gains = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    return s["v"] * gains + TABLE.sum()


DECISION = "a decision on data"
CAPTURED = "a tensor that is neither parameter nor buffer"
REFUSED: dict[Callable[[Sample], Tensor], tuple[str, str]] = {
    random_numbers: ("rand.default draws random numbers", "torch.rand(3"),
    random_like: ("randn_like.default draws random numbers", "torch.randn_like"),
    dropout: ("draws random numbers", "functional.dropout"),
    eigenvalues: ("_linalg_eigh.default has no compiled form", "eigvalsh"),
    eigenvectors: ("_linalg_eigh.default has no compiled form", "eigh("),
    singular_values: ("_linalg_svd.default has no compiled form", "svdvals"),
    item: ("a Python number made of data", ".item()"),
    number: (DECISION, "float(s"),
    listed: (DECISION, ".tolist()"),
    branch: (DECISION, 'if s["s"] > 0'),
    loop: (DECISION, "while x < 3"),
    mask: ("indexing by a mask", '[s["n"]].sum()'),
    some_of_them: ("indexing by a mask", '[s["n"]] *= 2'),
    single: ("computes in torch.float32, not in float64", ".float()"),
    single_from_whole: ("div.Tensor computes in torch.float32", "/ 3"),
    half: ("computes in torch.float16", ".half()"),
    bytes_that_wrap: ("numbers of torch.uint8", "torch.uint8"),
    complex_numbers: ("complex.default has no compiled form", "torch.complex"),
    spectrum: ("_fft_r2c.default has no compiled form", "rfft"),
    captured: (CAPTURED, "* TABLE"),
    captured_rows: (CAPTURED, "[ROWS]"),
    captured_by_a_module: (CAPTURED, "self.gain * x"),
    captured_twice: (CAPTURED, "TABLE.sum()"),
}


@pytest.mark.parametrize("function", REFUSED, ids=lambda f: f.__name__)
def test_refused_with_the_operation_and_its_line(function: Callable[[Sample], Tensor]) -> None:
    what, code = REFUSED[function]
    with pytest.raises(UntraceableError) as caught:
        Together([function], inputs())
    told = str(caught.value)
    assert what in told and code in told, told
    source, first = inspect.getsourcelines(Captor if "self." in code else function)
    line = next(first + i for i, text in enumerate(source) if code in text)
    assert f"test_refusals.py:{line}:" in told, told


def test_tensors_made_on_the_way_are_no_captives() -> None:
    def made(s: Sample) -> Tensor:
        gains = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
        rows = torch.arange(3).flip(0)
        return (s["v"] * gains)[rows] + s["v"][[2, 0, 1]] + torch.tensor(0.1)

    check_together({"made": made}, inputs())


@pytest.mark.parametrize(("number", "said"), [(0.3, "0.3 is 0.30000001192"), (0.5, None)])
def test_a_float32_literal_that_was_meant_otherwise_is_told_once(
    number: float, said: str | None, caplog: pytest.LogCaptureFixture
) -> None:
    def literal(s: Sample) -> Tensor:
        return s["v"] * torch.tensor(number)

    check_together({"literal": literal}, inputs())
    Together([literal], inputs())
    told = [record.message for record in caplog.records if "float32 constant" in record.message]
    assert len(told) == (said is not None) and all(str(said) in each for each in told)


def test_a_derivative_alone_may_be_refused() -> None:
    def floor(s: Sample) -> Tensor:
        return s["v"] // 0.3

    together = Together([floor], inputs())  # forwards there is nothing wrong with it
    assert torch.equal(
        together.split(together.run(inputs())[:2])[0], inputs().constants["v"] // 0.3
    )
    with pytest.raises(UntraceableError, match="floor_divide is not implemented"):
        together.program.backward(1, together.wanted, ())
