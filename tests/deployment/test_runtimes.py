"""Deployed steps in other runtimes: state in, state out, as the stepper does it."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from experiments.building.build import build
from experiments.building.ensembles import composed
from mann_torch.deployment import DIVERGED, REFUSED, SATURATED
from mann_torch.deployment.runtimes import (
    AotiTick,
    ExportedTick,
    OnnxTick,
    exported,
    to_aoti,
    to_onnx,
    to_torch_export,
)
from mann_torch.deployment.runtimes.flat import FlatTick, FlatTicked, Running, check_agreement
from mann_torch.errors import ConfigError, ExportError, KindError
from tests.conftest import CONTROLLERS, make_controller
from tests.pages import text_of

PERIOD = 1e-3
NOT_A_NUMBER, HUGE, FROZEN = 50, 55, range(60, 80)
CLOSE = {torch.float64: 1e-12, torch.float32: 1e-4}
ABSENT = [n for n in ("onnx", "onnxruntime", "onnxscript") if importlib.util.find_spec(n) is None]
with_onnx = pytest.mark.skipif(bool(ABSENT), reason=f"{ABSENT} not installed: the extra `deploy`")


def paper(name: str, **options: object) -> mt.Stepper:
    """One of the paper's controllers, at a limit of 300 N m."""
    given = {"engine": "torch", "actuator": mt.Actuator(2, limit=300.0), **options}
    return mt.deploy(make_controller(name), PERIOD, **given)


def limited(dtype: torch.dtype = torch.float64) -> mt.Stepper:
    """MRAC with a reference model, a limited input and what protects it (problem 7)."""
    loop = build(composed(("problem=limited_input",))).loop
    return mt.deploy(loop, PERIOD, dtype=dtype, engine="torch")


def rows(stepper: mt.Stepper, seed: int, scale: float = 1.0) -> tuple[Tensor, Tensor]:
    ports, g = stepper.ports, torch.Generator().manual_seed(seed)
    reference, measurement = (
        scale * torch.randn(len(row), generator=g).to(stepper.dtype)
        for row in (ports.reference, ports.measurement)
    )
    return reference, measurement


def compare(stepper: mt.Stepper, running: Running, scale: float = 1.0, ticks: int = 300) -> None:
    """Ticks of both, each from its own state; not a number, overflow and frozen ones among them."""
    state = stepper.initial_state(*rows(stepper, 0, scale))
    f, k = stepper.blob.split(state)
    met = set()
    for tick in range(ticks):
        reference, measurement = rows(stepper, tick, scale)
        if tick == NOT_A_NUMBER:
            measurement[-1] = torch.nan
        if tick == HUGE:
            measurement *= torch.finfo(stepper.dtype).max / 1e3
        adapt = tick not in FROZEN
        found = running(f, k, reference, measurement, torch.tensor(adapt))
        u, state, flags = stepper.step(state, reference, measurement, adapt)
        met.add(flags)
        assert int(found.flags) == flags, tick
        if flags & (REFUSED | DIVERGED):
            assert torch.equal(found.next_f, f) and torch.equal(found.next_k, k)
        f, k = found.next_f, found.next_k
        wanted = stepper.blob.split(state)[0]
        for one, other in ((found.input, u), (f, wanted)):
            assert one.dtype == stepper.dtype
            assert (one - other).abs().max() <= CLOSE[stepper.dtype] * other.abs().max(), tick
    assert {0, REFUSED, DIVERGED, SATURATED} <= met
    again = stepper.from_bytes(stepper.to_bytes(stepper.blob.joined(f, k)))
    assert torch.equal(stepper.blob.split(again)[0], f)


def onnx_of(stepper: mt.Stepper, folder: Path) -> OnnxTick:
    return OnnxTick(to_onnx(stepper, folder / "controller.onnx"))


def aoti_of(stepper: mt.Stepper, folder: Path) -> AotiTick:
    return AotiTick(to_aoti(stepper, folder / "controller.pt2"))


def compiler() -> None:
    from mann_torch.deployment.runtimes.aoti import check_aoti

    try:
        check_aoti()
    except ExportError as error:
        pytest.skip(str(error))


def test_an_exported_program_runs_as_the_stepper() -> None:
    stepper = paper("hard_state_keys")
    compare(stepper, ExportedTick(exported(stepper)), ticks=90)


def test_constants_are_those_of_the_stepper() -> None:
    stepper = mt.deploy(controller := make_controller("nn"), PERIOD, engine="torch")
    given = *stepper.blob.split(stepper.initial_state(*rows(stepper, 0))), *rows(stepper, 1)
    with torch.no_grad():
        controller.robust.base_gain.fill_(40.0)
    ours, late = (FlatTick(s) for s in (stepper, mt.deploy(controller, PERIOD, engine="torch")))
    u, _, _, _ = ours(*given, torch.tensor(True))
    assert torch.equal(u, stepper(stepper.blob.joined(*given[:2]), *given[2:])[0])
    assert not torch.equal(u, late(*given, torch.tensor(True))[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_exported_programs_of_the_papers_controllers_run_as_the_stepper(
    name: str, dtype: torch.dtype
) -> None:
    stepper = paper(name, dtype=dtype)
    compare(stepper, ExportedTick(exported(stepper)))


@with_onnx
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_onnx_runs_a_protected_mrac_as_the_stepper(dtype: torch.dtype, tmp_path: Path) -> None:
    stepper = limited(dtype)
    compare(stepper, onnx_of(stepper, tmp_path), 5.0)
    assert [path.name for path in tmp_path.iterdir()] == ["controller.onnx"]


@with_onnx
@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_onnx_runs_the_papers_controllers_as_the_stepper(
    name: str, dtype: torch.dtype, tmp_path: Path
) -> None:
    stepper = paper(name, dtype=dtype)
    compare(stepper, onnx_of(stepper, tmp_path))


@with_onnx
@pytest.mark.slow
def test_onnx_follows_a_reference_model(tmp_path: Path) -> None:
    """What is random is kept small: noise that the model's errors amplify is amplified rounding."""
    model, actuator = mt.parts.SecondOrderModel(2, 5.0), mt.Actuator(2, limit=300.0)
    stepper = paper("hard", model=model, actuator=actuator)
    compare(stepper, onnx_of(stepper, tmp_path), 0.2)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_aoti_runs_the_papers_controllers_as_the_stepper(name: str, tmp_path: Path) -> None:
    compiler()
    stepper = paper(name)
    compare(stepper, aoti_of(stepper, tmp_path))


@pytest.mark.slow
def test_aoti_runs_float32(tmp_path: Path) -> None:
    compiler()
    stepper = paper("reallocating_initial", dtype=torch.float32)
    compare(stepper, aoti_of(stepper, tmp_path))


@pytest.mark.slow
def test_aoti_runs_a_protected_mrac_as_the_stepper(tmp_path: Path) -> None:
    compiler()
    stepper = limited()
    compare(stepper, aoti_of(stepper, tmp_path), 5.0)


ALONE = """
import sys, torch
program = torch.export.load("controller.pt2", extra_files=(told := {"mann_torch.period_s": ""}))
given = torch.load("given.pt")
with torch.no_grad():
    torch.save(program.module()(*given), "found.pt")
print(told["mann_torch.period_s"], any(name.startswith("mann_torch") for name in sys.modules))
"""


@pytest.mark.slow
def test_an_exported_file_needs_torch_alone(tmp_path: Path) -> None:
    stepper = paper("reallocating_initial")
    to_torch_export(stepper, tmp_path / "controller.pt2")
    state = stepper.initial_state(*rows(stepper, 0))
    given = [*stepper.blob.split(state), *rows(stepper, 1), torch.tensor(True)]
    torch.save([x.clone() for x in given], tmp_path / "given.pt")
    done = subprocess.run(
        [sys.executable, "-c", ALONE], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["0.001", "False"]
    found = FlatTicked(*torch.load(tmp_path / "found.pt"))
    u, after, flags = stepper.step(state, *rows(stepper, 1))
    assert torch.equal(found.input, u) and int(found.flags) == flags
    assert torch.equal(found.next_f, stepper.blob.split(after)[0])


@with_onnx
@pytest.mark.slow
def test_a_file_says_which_number_is_what(tmp_path: Path) -> None:
    stepper = paper("nn")
    session = onnx_of(stepper, tmp_path).session
    told = session.get_modelmeta().custom_metadata_map
    assert json.loads(told["mann_torch.measurement"]) == [
        list(x) for x in stepper.ports.measurement
    ]
    assert json.loads(told["mann_torch.state_f"]) == session.get_inputs()[0].shape[0]


@with_onnx
@pytest.mark.slow
def test_the_page_says_how_onnx_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = re.findall(r"```py\n(.*?)```", text_of("deploy.md"), re.S)
    monkeypatch.chdir(tmp_path)
    stepper = mt.deploy(make_controller("reallocating_initial"), PERIOD, engine="torch")
    state = stepper.initial_state(*rows(stepper, 0))
    names = {"stepper": stepper, "state": state}
    exec(compile(code, "docs/deploy.md", "exec"), names)
    still = (torch.zeros(n, dtype=torch.float64) for n in (6, 4))
    u, after, flags = stepper.step(state, *still)
    assert int(names["flags"]) == flags
    assert torch.as_tensor(names["u"]) == pytest.approx(u, rel=1e-12)
    assert torch.as_tensor(names["f"]) == pytest.approx(stepper.blob.split(after)[0], abs=1e-12)


def test_a_runtime_with_other_numbers_is_refused() -> None:
    stepper = limited()
    tick = FlatTick(stepper)

    def wrong(*given: Tensor) -> FlatTicked:
        found = FlatTicked(*tick(*given))
        return found._replace(next_f=found.next_f * (1.0 + 1e-9))

    def careless(*given: Tensor) -> FlatTicked:
        return FlatTicked(*tick(*(x.nan_to_num() for x in given)))

    check_agreement(stepper, lambda *given: FlatTicked(*tick(*given)), "it")
    with pytest.raises(ExportError, match="it does not run Mrac as the stepper does: off by"):
        check_agreement(stepper, wrong, "it")
    with pytest.raises(ExportError, match="flags 0 where it has 1"):
        check_agreement(stepper, careless, "it")


def test_what_can_not_be_traced_is_named(tmp_path: Path) -> None:
    class Asking(mt.SoftAttention):
        def forward(self, comparison, active):  # type: ignore[no-untyped-def]
            weights = super().forward(comparison, active)
            return weights if bool((weights >= 0.0).all()) else -weights

    controller = mt.MannController(2, 6, mt.WorkingMemory(2, 6, Asking()))
    stepper = mt.deploy(controller, PERIOD, engine="torch")
    with pytest.raises(ExportError, match=r"^torch.export can't trace MannController: [^\n]+$"):
        to_torch_export(stepper, tmp_path / "controller.pt2")
    assert not list(tmp_path.iterdir())


@with_onnx
@pytest.mark.slow
def test_an_operation_that_onnx_lacks_is_named(tmp_path: Path) -> None:
    stepper = mt.deploy(build(composed(("problem=quadrotor_pid",))).loop, engine="torch")
    with pytest.raises(ExportError, match=r"can't be written as ONNX: .*linalg_solve[^\n]*$"):
        to_onnx(stepper, tmp_path / "controller.onnx")
    assert not list(tmp_path.iterdir())


def test_what_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stepper = limited()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ExportError, match=r"onnxruntime, onnxscript: pip install"):
        to_onnx(stepper, tmp_path / "controller.onnx")
    monkeypatch.setattr(torch._inductor.config.cpp, "cxx", (None, "no-such-compiler"))
    with pytest.raises(ExportError, match=r"AOTInductor needs a C\+\+ compiler"):
        to_aoti(stepper, tmp_path / "controller.pt2")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("write", [to_torch_export, to_aoti, to_onnx])
def test_bad_arguments_are_named(write: Callable[..., Path], tmp_path: Path) -> None:
    stepper = limited()
    suffix = ".onnx" if write is to_onnx else ".pt2"
    with pytest.raises(KindError, match="stepper"):
        write(stepper.tick, tmp_path / f"controller{suffix}")
    with pytest.raises(KindError, match="path = 3"):
        write(stepper, 3)
    with pytest.raises(ConfigError, match=f"ends in {suffix}"):
        write(stepper, tmp_path / "controller.bin")
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(ConfigError, match="is a folder"):
        write(stepper, tmp_path / f"folder{suffix}")
