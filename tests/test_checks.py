"""What counts as a number, a size, a flag; and that checks are there under `python -O`."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch import checks
from mann_torch.functional import as_float64
from tests.conftest import make_loop, make_scenario

NUMBERS = [
    1,
    0.5,
    np.float32(0.5),
    np.float64(0.5),
    np.int64(2),
    np.array(0.5),
    torch.tensor(0.5),
    torch.tensor(2),
    torch.tensor(0.5, requires_grad=True),
    Fraction(1, 2),
]
NONE = [True, np.bool_(True), np.array(True), torch.tensor(True), "1", None, 1j, np.ones(1)]
NONE += [torch.ones(1), torch.tensor(1j), Decimal(1), [1.0], torch.ones((), device="meta")]


@pytest.mark.parametrize("value", NUMBERS, ids=repr)
def test_what_float_takes_is_a_number(value: Any) -> None:
    found = checks.number("x", value, checks.POSITIVE)
    assert type(found) is float and found in (0.5, 1.0, 2.0)


@pytest.mark.parametrize("value", NONE, ids=repr)
def test_a_bool_is_no_number_and_nor_is_what_float_refuses(value: Any) -> None:
    with pytest.raises(mt.KindError, match=r"^x = .*: must be a number$"):
        checks.number("x", value)


@pytest.mark.parametrize("value", [0, -1.0, float("nan"), float("inf"), 10**400])
def test_a_number_out_of_range_says_the_range(value: float) -> None:
    with pytest.raises(mt.ConfigError, match=r"^x = .*(> 0|too large)$") as caught:
        checks.number("x", value, checks.POSITIVE)
    assert not isinstance(caught.value, TypeError)


def test_sizes_are_whole_numbers() -> None:
    for value in (3, np.int32(3), torch.tensor(3), np.array(3)):
        assert checks.whole("n", value) == 3 and type(checks.whole("n", value)) is int
    for shape in ((2, 3), [2, 3], torch.Size((2, 3)), np.array([2, 3]), torch.tensor([2, 3])):
        assert checks.sizes("shape", shape) == (2, 3)
    for bad in (True, np.bool_(True), torch.tensor(True), 2.0, "2", None, [2]):
        with pytest.raises(mt.KindError, match=r"n = .*whole number"):
            checks.whole("n", bad)
    for bad in (True, "23", {2: 3}, [2, True], [2.0], -1, [-1], None, torch.tensor(2.0)):
        with pytest.raises(mt.KindError, match="shape = "):
            checks.sizes("shape", bad)


def test_flags_names_and_rows() -> None:
    assert checks.flag("f", np.bool_(True)) is True
    for bad in (0, 1, "yes", None, np.ones(2, dtype=bool)):
        with pytest.raises(mt.KindError, match="True or False"):
            checks.flag("f", bad)
    for bad in (np.array(["a", "b"]), torch.ones(2), ["a"]):  # whose == is no bool
        with pytest.raises(mt.KindError, match=r"c = .*choose from a, b"):
            checks.choice("c", bad, ("a", "b"))
    for bad in (True, [1.0, True], [[1.0], [False]], np.array([True]), [torch.tensor(True)]):
        with pytest.raises(mt.KindError, match="a bool"):
            as_float64(bad, "x")
    for bad in ([[1.0], [1.0, 2.0]], 10**400):
        with pytest.raises(mt.ConfigError, match="x = "):
            as_float64(bad, "x")
    assert as_float64(np.float32([1, 2])).tolist() == [1.0, 2.0]


def test_a_class_in_place_of_an_instance_and_a_long_value_are_said_in_short() -> None:
    with pytest.raises(mt.KindError, match="attention = the class HardAttention: must be an Att"):
        mt.WorkingMemory(2, 3, mt.HardAttention)  # type: ignore[arg-type]
    with pytest.raises(mt.KindError, match=r"^loop = (a )?TwoLinkArm"):
        mt.rollout(mt.TwoLinkArm(), make_scenario())  # type: ignore[arg-type]
    with pytest.raises(mt.ConfigError, match=r"^horizon = .{,120}$"):
        mt.Scenario(mt.Sinusoid([1.0]), mt.arm_parameters(), ["x" * 1000])  # type: ignore[arg-type]


def test_numpy_numbers_run_a_loop() -> None:
    loop, scenario = make_loop("soft"), make_scenario(np.float64(0.02))
    step = mt.Implicit(0.004)
    plain = mt.rollout(loop, scenario, step, sample_dt=0.008, sample_until=1.0, engine="torch")
    numpy = mt.rollout(
        loop,
        scenario,
        mt.Implicit(np.array(0.004)),  # type: ignore[arg-type]
        sample_dt=np.float64(0.008),
        sample_until=torch.tensor(1.0),  # type: ignore[arg-type]
        batch_shape=np.array([], dtype=np.int64),  # type: ignore[arg-type]
        engine="torch",
    )
    assert torch.equal(plain.q, numpy.q) and torch.equal(plain.sample_t, numpy.sample_t)


def test_checked_parts_are_still_copied_and_pickled() -> None:
    loop, scenario = make_loop("reallocating_always"), make_scenario(0.02, (0.01,))
    run = mt.rollout(loop, scenario, engine="torch")
    for twin in (copy.deepcopy, lambda part: pickle.loads(pickle.dumps(part))):
        again = mt.rollout(twin(loop), twin(scenario), twin(mt.Implicit()), engine="torch")
        assert torch.equal(run.q, again.q)


SCRIPT = """
import mann_torch as mt
from tests.public_calls import CALLS
from tests.test_wrong_types import WRONG, wrongs
refused, taken = 0, []
for name, (call, good) in CALLS.items():
    for argument in good:
        for what in wrongs(name, argument):
            try:
                call(**{**good, argument: WRONG[what]})
                taken.append((name, argument, what))
            except mt.ConfigError:
                refused += 1
assert False, "gone under -O"
print(refused, taken)
"""


@pytest.mark.slow  # Python compiles all of torch again, where it may not keep what it compiled
def test_the_whole_table_is_refused_without_asserts() -> None:
    done = subprocess.run(
        [sys.executable, "-O", "-c", SCRIPT],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parent.parent,
    )
    assert done.returncode == 0, done.stderr
    refused, taken = done.stdout.split(maxsplit=1)
    assert taken.strip() == "[]" and int(refused) >= 2000
