"""Imports go one way only."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BASE = {
    "version",
    *("errors", "checks", "types", "functional", "domains", "constraints", "trees"),
    *("interface", "stiff", "registry", "telling"),
}
ALLOWED = {
    "memory": BASE | {"compiled"},
    "control": BASE | {"memory"},
    "plants": BASE,
    "signals": BASE,
    "parts": BASE,
    "compiled": {"errors", "telling"},
    "simulation": BASE | {"compiled", "memory", "control", "plants", "signals", "parts"},
    "deployment": BASE | {"compiled", "control", "parts", "plants", "simulation"},
    "metrics": BASE | {"simulation"},
    "statistics": BASE,
    "figures": BASE,
    "tuning": BASE | {"simulation", "metrics", "statistics"},
    "simulators": BASE
    | {"compiled", "control", "deployment", "plants", "signals", "parts", "simulation"},
    "testing": BASE
    | {"memory", "control", "plants", "signals", "parts", "simulation", "metrics", "deployment"},
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


def test_only_simulators_know_of_gymnasium_and_mujoco() -> None:
    for path in (ROOT / "mann_torch").rglob("*.py"):
        if path.parent.name != "simulators":
            assert not imported_parts(path) & {"gymnasium", "mujoco"}, path


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


#: Rooms of the experiments, lowest first; those of a line know nothing of each other.
ROOMS = (
    ("settings",),
    ("runs",),
    ("ensembles",),
    ("sweeps",),
    ("command",),
    ("records",),
    ("building", "sequence_tasks", "animations"),
    ("reproduction", "gradients", "tuning", "learning"),
    ("problems", "problem_tuning", "returns", "peering", "exporting"),
    ("benchmarking", "ablating"),
)


def imported_rooms(path: Path) -> set[str]:
    """Rooms and top files of the experiments that a file imports, in functions too."""
    depth = len(path.relative_to(ROOT / "experiments").parts)
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.ImportFrom):
            continue
        module = node.module or ""
        if node.level == depth and module:
            found.add(module.split(".")[0])
        elif node.level == depth:
            found |= {alias.name for alias in node.names}
        elif module.startswith("experiments"):
            found.add("absolute")
    return found


def test_experiments_import_downwards() -> None:
    levels = {room: level for level, line in enumerate(ROOMS) for room in line}
    folders = {path.name for path in (ROOT / "experiments").iterdir() if path.is_dir()}
    assert folders - {"__pycache__"} == set(levels)
    for room, level in levels.items():
        for path in (ROOT / "experiments" / room).glob("*.py"):
            for name in imported_rooms(path) - {room}:
                assert name in levels and levels[name] < level, (path, name)


def test_no_circle_within_a_room() -> None:
    for room in (room for line in ROOMS for room in line):
        waiting = {}
        for path in (ROOT / "experiments" / room).glob("*.py"):
            nodes = ast.walk(ast.parse(path.read_text()))
            waiting[path.stem] = {
                (node.module or "").split(".")[0]
                for node in nodes
                if isinstance(node, ast.ImportFrom) and node.level == 1
            }
        while waiting:
            free = [name for name, needs in waiting.items() if not needs & waiting.keys()]
            assert free, (room, waiting)
            for name in free:
                del waiting[name]


def test_every_room_and_file_of_the_experiments_is_named_in_the_architecture() -> None:
    page = (ROOT / "ARCHITECTURE.md").read_text()
    for path in (ROOT / "experiments").rglob("*.py"):
        if path.stem != "__init__":
            assert f"`{path.stem}`" in page, path


def test_commands_import_no_other_command() -> None:
    commands = {path.stem for path in (ROOT / "experiments").glob("*.py")} - {"__init__"}
    for name in commands:
        assert not imported_rooms(ROOT / "experiments" / f"{name}.py") & (commands - {name}), name
