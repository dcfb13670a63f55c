"""A controller as C: the steps of Python's stepper to the bit, and what must not harm."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.errors import ConfigError, ExportError, KindError
from tests.compiled.c99_building import undefined
from tests.conftest import make_controller

from .c_calling import NAME, InC, made


def deployed(dtype: torch.dtype = torch.float64, name: str = "reallocating_initial") -> mt.Stepper:
    return mt.deploy(make_controller(name), 1e-3, dtype=dtype)


def rows(count: int, dtype: torch.dtype, seed: int = 0) -> list[tuple[Tensor, Tensor]]:
    g = torch.Generator().manual_seed(seed)
    walk = 0.2 * torch.randn(count, 10, generator=g, dtype=torch.float64).cumsum(0) / count**0.5
    return [(row[:6].to(dtype), row[6:].to(dtype)) for row in walk]


@pytest.fixture(scope="module")
def stepper() -> mt.Stepper:
    return deployed()


@pytest.mark.parametrize(
    ("dtype", "constants"),
    [(torch.float64, "baked"),
     *(pytest.param(*p, marks=pytest.mark.slow) for p in
       ((torch.float64, "struct"), (torch.float32, "baked"), (torch.float32, "struct")))],
)  # fmt: skip
def test_steps_are_those_of_python_to_the_bit(
    dtype: torch.dtype, constants: str, tmp_path: Path
) -> None:
    stepper = deployed(dtype)
    c, given = InC(stepper, tmp_path / "out", constants), rows(200, dtype)
    state, n = stepper.initial_state(*given[0]), stepper.blob.n_f
    # torch's own functions begin: they may be off by a unit in the last place.
    close = 1e-6 if dtype == torch.float32 else 1e-14
    torch.testing.assert_close(c.initial_state(*given[0])[:n], state[:n], rtol=close, atol=0.0)
    own = c.from_bytes(stepper.to_bytes(state))
    assert isinstance(own, Tensor) and torch.equal(own[:n], state[:n])
    for k, row in enumerate(given):
        expected = stepper.step(state, *row, adapt=k % 7 < 5)
        found = c.step(own, *row, adapt=k % 7 < 5)
        assert torch.equal(found.input, expected.input) and found.flags == expected.flags, k
        state, own = expected.state, found.state
    assert c.to_bytes(own) == stepper.to_bytes(state)


def test_the_test_that_is_written_with_it_holds(stepper: mt.Stepper, tmp_path: Path) -> None:
    folder = stepper.to_c(tmp_path / "out", NAME, libm=False)
    assert "all holds" in made(folder, "test")
    assert undefined(folder / f"{NAME}.o") == set()
    # It can fail: a period that is another one.
    text = (folder / f"{NAME}.c").read_text()
    assert "0x1.0624dd2f1a9fcp-10" in text
    (folder / f"{NAME}.c").write_text(text.replace("0x1.0624dd2f1a9fcp-10", "0x1.07p-10"))
    with pytest.raises(AssertionError, match="FAILED: commands and state"):
        made(folder, "test")


@pytest.mark.slow
def test_constants_are_set_at_run_time(tmp_path: Path) -> None:
    controller = make_controller("nn")
    before = mt.deploy(controller, 1e-3)
    c = InC(before, tmp_path / "out", "struct")
    header = (tmp_path / "out" / f"{NAME}.h").read_text()
    struct = header[header.index("// Constants") :]
    place = 0
    for name, count in re.findall(r"^  ctl_real (\w+)(?:\[(\d+)\])?;", struct, re.M):
        if name == "base_gain":
            break
        place += int(count or 1)
    assert c.constants is not None and c.constants[place] == float(controller.robust.base_gain)
    c.constants[place] *= 1.5
    with torch.no_grad():
        controller.robust.base_gain.mul_(1.5)
    after = mt.deploy(controller, 1e-3)
    given = rows(20, torch.float64)
    state, own = after.initial_state(*given[0]), c.initial_state(*given[0])
    for row in given:
        u, state = after(state, *row)
        found = c.step(own, *row)
        own = found.state
        torch.testing.assert_close(found.input, u, rtol=1e-12, atol=0.0)


def test_what_is_written(stepper: mt.Stepper, tmp_path: Path) -> None:
    folder = stepper.to_c(tmp_path / "new" / "out", NAME)
    files = {path.name for path in folder.iterdir()}
    assert files == {"Makefile", "README.md", f"{NAME}.c", f"{NAME}.h", f"test_{NAME}.c"}
    assert [path.name for path in folder.parent.iterdir()] == ["out"]
    readme = (folder / "README.md").read_text()
    for words in (
        "q_1 acceleration",
        "rad/s",
        "N m",
        "`f[CTL_F_controller_network_V]`",
        "C_w",
        "0.001 s",
    ):
        assert words in readme
    source = (folder / f"{NAME}.c").read_text()
    assert not re.search(r"\b(malloc|free|alloca|static (?!const|inline|void|uint64_t))\b", source)


@pytest.mark.slow
def test_an_export_is_replaced_whole_and_nothing_else_is(
    stepper: mt.Stepper, tmp_path: Path
) -> None:
    folder = stepper.to_c(tmp_path / "out", NAME)
    text = (folder / f"{NAME}.c").read_text()
    (folder / f"{NAME}.c").write_text("")
    (folder / f"{NAME}.o").write_text("")
    stepper.to_c(folder, NAME)
    assert (folder / f"{NAME}.c").read_text() == text
    assert not (folder / f"{NAME}.o").exists()
    with pytest.raises(ExportError, match="holds something else"):
        stepper.to_c(folder, "other")
    with pytest.raises(ExportError, match="holds something else"):
        deployed(name="nn").to_c(tmp_path, NAME)
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="is a file"):
        stepper.to_c(tmp_path / "file", NAME)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "out"]
    assert (folder / f"{NAME}.c").read_text() == text


def test_what_is_wrong_is_named(stepper: mt.Stepper, tmp_path: Path) -> None:
    for name in ("Big", "1st", "a b", "int", "", "x" * 42, "a-b"):
        with pytest.raises(ConfigError, match="C identifier"):
            stepper.to_c(tmp_path / "out", name)
    with pytest.raises(ConfigError, match="constants = 'hot': choose from baked, struct"):
        stepper.to_c(tmp_path / "out", constants="hot")
    with pytest.raises(KindError, match="libm"):
        stepper.to_c(tmp_path / "out", libm="yes")
    with pytest.raises(KindError, match="folder"):
        stepper.to_c(3)
    assert not list(tmp_path.iterdir())


def test_what_can_not_be_traced_is_refused_in_a_line(tmp_path: Path) -> None:
    class Asking(mt.SoftAttention):
        def forward(self, comparison, active):  # type: ignore[no-untyped-def]
            weights = super().forward(comparison, active)
            return weights if bool((weights >= 0.0).all()) else -weights

    memory = mt.WorkingMemory(2, 6, Asking())
    with pytest.raises(ExportError, match="decision on data") as found:
        mt.deploy(mt.MannController(2, 6, memory), 1e-3).to_c(tmp_path / "out")
    assert "\n" not in str(found.value) and not list(tmp_path.iterdir())


@pytest.mark.slow
def test_too_large_a_controller_is_refused(tmp_path: Path) -> None:
    memory = mt.WorkingMemory(100, 400, mt.HardAttention(), mt.RepresentationKeys())
    large = mt.deploy(mt.MannController(2, 400, memory), 1e-3, engine="torch")
    with pytest.raises(ExportError, match="KiB") as found:
        large.to_c(tmp_path / "out")
    assert "\n" not in str(found.value) and not list(tmp_path.iterdir())
