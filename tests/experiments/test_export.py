"""The command that writes controllers: what it leaves, that it runs, and what it refuses."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from experiments import export
from experiments.command.cli import compose_job
from experiments.export import checked
from experiments.exporting.composing import first_state, learned_state
from experiments.exporting.runtimes import RUNTIMES
from mann_torch import rollout
from mann_torch.deployment.runtimes import AotiTick, ExportedTick, OnnxTick
from mann_torch.simulation import observe
from tests.experiments.command import exit_code

#: As quick to write as any.
SMALL = ("plant=pendulum", "scenario=plain", "controller=pid")


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    return exit_code(monkeypatch, export.main, *arguments)


def record(folder: Path) -> Any:
    return json.loads((folder / "metrics.json").read_text())


def test_c_code_is_written_and_its_own_test_passes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "run"
    asked = ("controller=nn", "export.name=arm", "export.period=2e-3", "clock.period=2e-3")
    asked += ("seed=3", "initial.draw=2")
    assert run(monkeypatch, *asked, f"run_dir={folder}") == 0
    report, told = (folder / "report.md").read_text(), record(folder)
    assert capsys.readouterr().out.startswith(report)
    assert {"arm.h", "arm.c", "README.md", "Makefile", "test_arm.c"} <= told["files"]["c"].keys()
    for name, size in told["files"]["c"].items():
        assert (folder / "c" / name).stat().st_size == size
        assert re.search(rf"c/{re.escape(name)} +\| {size} ", report)
    assert told["period"] == 2e-3 and "q_2 acceleration" in report and "torque_1" in report
    assert "every 0.002 s" in report
    # The draw that `simulate` has is what the controller itself starts from.
    cfg, made, stepper = checked(compose_job("export", [*asked]))
    kept = (folder / "start.state").read_bytes()
    assert kept == stepper.to_bytes(first_state(cfg, made, stepper))
    own = stepper.initial_state(torch.zeros(6).double(), torch.zeros(4).double())
    for state in (own, stepper.from_bytes(kept)):
        V = stepper.unpacked(state).controller.network.V
        torch.testing.assert_close(V, made.weights.V[0], rtol=0, atol=0)
    if shutil.which("make") is None or shutil.which("cc") is None:
        pytest.skip("no C compiler here")
    made = subprocess.run(["make", "test"], cwd=folder / "c", capture_output=True, text=True)
    assert made.returncode == 0, made.stderr


@pytest.mark.parametrize(
    "told",
    [
        ("horizon=2", "controller=reallocating_initial"),
        *(
            pytest.param(other, marks=pytest.mark.slow)
            for other in (
                ("problem=scalar_mrac", "horizon=2"),
                ("plant=pendulum", "scenario=plain", "horizon=2", "model=second_order"),
            )
        ),
    ],
)
def test_what_was_learned_gives_the_command_that_the_loop_would(told: tuple[str, ...]) -> None:
    cfg, made, stepper = checked(compose_job("export", [*told, "export.learned=true"]))
    state = learned_state(cfg, made, stepper)
    run = rollout(
        made.loop, made.scenario, made.solver, weights=made.weights, sample_dt=made.scenario.end
    )
    seen = observe(made.loop, made.scenario, run)

    def last(row: Tensor) -> Tensor:
        return row[-1].reshape(-1)

    ports = stepper.ports
    reference = made.scenario.reference(run.sample_t).upto(ports.order)
    u, _, flags = stepper.step(
        state,
        torch.cat([last(part) for part in reference]),
        torch.cat([last(part) for part in seen.measurement]),
    )
    torch.testing.assert_close(u, last(seen.input), rtol=1e-10, atol=1e-10)
    assert flags == 0
    fresh = stepper.unpacked(first_state(cfg, made, stepper)).controller
    kept = stepper.unpacked(state).controller
    moved = [
        float((a - b).abs().max())
        for a, b in zip(
            torch.utils._pytree.tree_leaves(fresh),
            torch.utils._pytree.tree_leaves(kept),
            strict=True,
        )
        if isinstance(a, Tensor) and a.numel()
    ]
    assert max(moved, default=1.0) > 1e-3


def test_tuned_constants_come_first(tmp_path: Path) -> None:
    (tmp_path / "constants.json").write_text(
        json.dumps({"constants": {"write_gain": 1.25, "error_gain": [[7.0, 0.0], [0.0, 6.0]]}})
    )
    for path in (tmp_path, tmp_path / "constants.json"):
        told = [f"export.tuned={path}", "constants.write_gain=0.3", "constants.base_gain=11"]
        _, made, _ = checked(compose_job("export", told))
        assert float(made.loop.constant("write_gain")) == 1.25
        assert float(made.loop.constant("base_gain")) == 11.0
        assert made.loop.constant("error_gain").diagonal().tolist() == [7.0, 6.0]


@pytest.mark.slow
def test_a_struct_in_float32_without_libm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    told = ("export.constants=struct", "export.dtype=float32", "export.libm=false")
    assert run(monkeypatch, *SMALL, *told, "run_dir=run") == 0
    header = (tmp_path / "run" / "c" / "controller.h").read_text()
    assert "controller_default_constants" in header and "typedef float" in header
    assert "<math.h>" not in (tmp_path / "run" / "c" / "controller.c").read_text()


@pytest.mark.slow
def test_every_runtime_has_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("onnx", "onnxruntime", "onnxscript"):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    every = f"export.runtimes=[{','.join(RUNTIMES)}]"
    assert run(monkeypatch, "controller=soft", every, "export.name=arm", "run_dir=run") == 0
    found, report = record(tmp_path / "run")["files"], (tmp_path / "run" / "report.md").read_text()
    assert found.keys() == set(RUNTIMES)
    assert not (tmp_path / "run" / "export.log").exists()
    for name, file in (("torch_export", "pt2"), ("aoti", "pt2"), ("onnx", "onnx")):
        assert list(found[name]) == [f"arm.{file}"] and f"{name}/arm.{file}" in report
    # From the saved start they all take the same step.
    _, _, stepper = checked(compose_job("export", ["controller=soft"]))
    state = stepper.from_bytes((tmp_path / "run" / "start.state").read_bytes())
    rows = 0.1 * torch.ones(6).double(), 0.05 * torch.ones(4).double()
    wanted = stepper.step(state, *rows).input
    for kind, path in (
        (ExportedTick, "torch_export/arm.pt2"),
        (AotiTick, "aoti/arm.pt2"),
        (OnnxTick, "onnx/arm.onnx"),
    ):
        ticked = kind(tmp_path / "run" / path)(
            *stepper.blob.split(state), *rows, torch.tensor(True)
        )
        torch.testing.assert_close(ticked.input, wanted, rtol=1e-12, atol=1e-12)


def test_a_missing_package_is_named_before_anything_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert run(monkeypatch, *SMALL, "export.runtimes=[onnx]") == 2
    said = capsys.readouterr().err
    assert "pip install 'mann_torch[deploy]'" in said and said.count("\n") == 1
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
def test_what_stays_in_the_simulator_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    parts = ("actuator=lagged", "sensor=noisy", "disturbance=input")
    assert run(monkeypatch, *SMALL, *parts, "run_dir=run") == 0
    _, _, left = (tmp_path / "run" / "report.md").read_text().partition("## Not exported")
    assert all(word in left for word in ("lag", "noise", "the disturbance"))


def test_what_cannot_be_written_is_one_line_and_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for arguments, word in (
        (("export.name=3d",), "name = '3d'"),
        (("export.name=while",), "name = 'while'"),
        (("export.dtype=float16",), "export.dtype = float16: choose from float64, float32"),
        (("export.constants=frozen",), "export.constants = frozen: choose from baked, struct"),
        (("export.runtimes=[fortran]",), "unknown export.runtime 'fortran'"),
        (("export.period=-1",), "export.period"),
        (("export.period=1e-3", "clock.period=0.01"), "the loop's clock has 0.01 s"),
        (("clock=periodic", "clock.hold=first"), "hold"),
        (("problem=wing_rock_concurrent", "export.dtype=float32"), "take float64"),
        (("problem=wing_rock_concurrent", "export.period=7e-3"), "a whole number of periods"),
        (("plant=cart_pole", "scenario=plain"), "a plant of 1 inputs and 2 outputs"),
        (("export.tuned=/nowhere",), "export.tuned: /nowhere"),
    ):
        assert run(monkeypatch, *arguments) == 2, arguments
        out, err = capsys.readouterr()
        assert word in err and err.count("\n") == 1 and out == "", (arguments, err)
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
def test_a_finished_export_is_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, *SMALL, "run_dir=run") == 0
    first = {p: p.stat().st_mtime_ns for p in (tmp_path / "run").rglob("*.c")}
    capsys.readouterr()
    assert first and run(monkeypatch, *SMALL, "run_dir=run") == 0
    assert "finished already, skipped" in capsys.readouterr().out
    # What a run did that was killed before its mark is done again, and what it left half removed.
    (tmp_path / "run" / "metrics.json").unlink()
    (tmp_path / "run" / ".c-a1b2c3d4").mkdir()
    (tmp_path / "run" / ".c-a1b2c3d4" / "controller.h").write_text("half a ")
    assert run(monkeypatch, *SMALL, "run_dir=run") == 0
    assert record(tmp_path / "run")["files"]["c"]
    assert all(path.exists() for path in first)
    assert not list((tmp_path / "run").glob(".c-*"))
