"""`mann_torch.__all__` is the API: all of it importable, documented, and nothing left out."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import mann_torch as mt
import mann_torch.memory
import mann_torch.tuning

HOME = Path(mt.__file__).parent
PACKAGES = {p.__name__: p for p in (mt, mann_torch.memory, mann_torch.tuning)}
PUBLIC = [(p, n) for p, package in PACKAGES.items() for n in package.__all__]


def imported_for_type_checkers() -> set[str]:
    """The names in the block that mypy and editors read."""
    tree = ast.parse((HOME / "__init__.py").read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    return {a.name for node in block.body if isinstance(node, ast.ImportFrom) for a in node.names}


def test_all_is_sorted_and_what_type_checkers_see() -> None:
    assert len(set(mt.__all__)) == len(mt.__all__)
    assert set(mt.__all__) == imported_for_type_checkers()
    assert set(mt.__all__) <= set(dir(mt))


@pytest.mark.parametrize(("package", "name"), PUBLIC)
def test_every_public_name_is_there_and_documented(package: str, name: str) -> None:
    found = getattr(PACKAGES[package], name)
    if not (inspect.isclass(found) or inspect.isfunction(found)):
        return  # a constant
    assert found.__module__.startswith("mann_torch.")
    assert (found.__doc__ or "").strip() and not found.__doc__.startswith(f"{name}("), name
    for member, value in vars(found).items() if inspect.isclass(found) else ():
        ours = inspect.isfunction(value) or isinstance(value, property | classmethod)
        if ours and not member.startswith("_"):
            assert inspect.getdoc(getattr(found, member)), f"{name}.{member}"


#: Of which the public classes are made; and what runs them.
MADE_OF, ROOM = (
    {
        "CellStep",
        "CellFlow",
        "Padded",
        "Marks",
        "StreamStep",
        "Streamed",
        "SequenceStep",
        "Held",
        "Row",
        "Rows",
    },
    "engine",
)


def test_nothing_public_of_the_memory_is_missing() -> None:
    home = HOME / "memory"
    for path in (p for p in home.rglob("*.py") if ROOM not in p.parts):
        module = ".".join(("mann_torch.memory", *path.relative_to(home).with_suffix("").parts))
        for name, value in vars(sys.modules.get(module, mt)).items():
            if inspect.isclass(value) and value.__module__ == module and name[0] != "_":
                if name in MADE_OF:
                    continue
                assert name in mann_torch.memory.__all__, name


def test_every_error_is_public() -> None:
    for name, value in vars(mt.errors).items():
        if inspect.isclass(value) and issubclass(value, mt.MannError):
            assert name in mt.__all__


def test_a_first_import_finds_each_name_and_refuses_others() -> None:
    code = (
        "import mann_torch as mt; from mann_torch import *\n"
        "assert all(globals()[n] is getattr(mt, n) for n in mt.__all__)\n"
        "assert mt.memory.MemoryCell is mt.MemoryCell\n"
        "try: mt.NoSuchName\n"
        "except AttributeError as error: print(error)"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=HOME.parent
    )
    assert out.stdout.strip() == "module 'mann_torch' has no attribute 'NoSuchName'"
