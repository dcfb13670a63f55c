"""`python -m mann_torch.testing`: every layer is tried, and what fails is told."""

from mann_torch.errors import KernelError
from mann_torch.testing.self_check import CHECKS, run
from mann_torch.version import __version__


def test_everything_works_here() -> None:
    lines: list[str] = []
    assert run(lines.append) == 0
    assert lines[0].startswith(f"mann_torch {__version__}, Python ")
    assert [line.split()[0] for line in lines[1:]] == list(CHECKS)
    assert all(line.split()[3] == "ok" for line in lines[1:])


def test_what_fails_is_counted_and_named_and_the_rest_goes_on() -> None:
    def wrong() -> str:
        raise KernelError("1.0e-01 apart\nand more")

    lines: list[str] = []
    checks = {"first": wrong, "second": lambda: "fine"}
    assert run(lines.append, checks) == 1
    assert lines[1].endswith("FAILED  KernelError: 1.0e-01 apart")
    assert lines[2].endswith("ok      fine")
