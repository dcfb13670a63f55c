"""Imports go one way only."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BASE = {"errors", "types", "functional", "constraints", "trees"}
ALLOWED = {
    "memory": BASE,
    "control": BASE | {"memory"},
    "plants": BASE,
    "signals": BASE,
    "compiled": {"errors"},
    "simulation": BASE | {"compiled", "memory", "control", "plants", "signals"},
    "metrics": BASE | {"simulation"},
    "statistics": BASE,
    "figures": BASE,
    "tuning": BASE | {"simulation", "metrics", "statistics"},
}


def imported_parts(path: Path) -> set[str]:
    """First-level parts of mann_torch, and other packages, that a file imports."""
    depth = len(path.relative_to(ROOT / "mann_torch").parts)
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level == 0:
                found.add(module.split(".")[0])
            elif node.level == depth and module:
                found.add("mann_torch." + module.split(".")[0])
            elif node.level > depth:
                found.add("outside")
    return found


@pytest.mark.parametrize("layer", sorted(ALLOWED))
def test_layer_imports_only_lower_layers(layer: str) -> None:
    folder = ROOT / "mann_torch" / layer
    files = sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]
    assert files
    for path in files:
        for name in imported_parts(path):
            assert name != "outside"
            if name.startswith("mann_torch."):
                assert name.removeprefix("mann_torch.") in ALLOWED[layer] | {layer}, (path, name)


def test_base_files_import_only_each_other() -> None:
    for name in BASE:
        parts = imported_parts(ROOT / "mann_torch" / f"{name}.py")
        inner = {p.removeprefix("mann_torch.") for p in parts if p.startswith("mann_torch.")}
        assert inner <= BASE, name


def test_one_file_imports_torchdiffeq_and_none_hydra_or_tensorboard() -> None:
    users: dict[str, list[str]] = {"torchdiffeq": [], "hydra": [], "tensorboard": [], "warp": []}
    for path in (ROOT / "mann_torch").rglob("*.py"):
        for name in imported_parts(path) & set(users):
            users[name].append(path.name)
    hosts = {path.name for path in (ROOT / "mann_torch/compiled/host").glob("*.py")}
    assert set(users.pop("warp")) <= hosts
    assert users == {"torchdiffeq": ["odeint.py"], "hydra": [], "tensorboard": []}


def test_importing_the_memory_loads_no_solver_plant_control_or_hydra() -> None:
    foreign = ("torchdiffeq", "warp", "hydra", "tensorboard", "scipy", "matplotlib", "experiments")
    code = (
        "import sys, mann_torch.memory\n"
        f"print([m for m in sys.modules if m.split('.')[0] in {foreign}])\n"
        "print(sorted({m.split('.')[1] for m in sys.modules if m.startswith('mann_torch.')}))"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    found, parts = map(ast.literal_eval, out.stdout.splitlines())
    assert found == []
    assert "memory" in parts and set(parts) <= BASE | {"memory"}


def test_files_stay_readable() -> None:
    for folder in ("mann_torch", "experiments"):
        for path in (ROOT / folder).rglob("*.py"):
            assert len(path.read_text().splitlines()) <= 250, path


def test_one_file_touches_torchs_tracing_internals() -> None:
    """What moves between torch's versions is in one place."""
    words = ("proxy_tensor", "torch._decomp", "torch.func.functionalize", "_reparametrize_module")
    words += ("torch._C._are_functorch", "forward_ad")
    users = {
        path.relative_to(ROOT / "mann_torch").as_posix()
        for path in (ROOT / "mann_torch").rglob("*.py")
        if any(word in path.read_text() for word in words)
    }
    assert users == {"compiled/trace/tracing.py"}
