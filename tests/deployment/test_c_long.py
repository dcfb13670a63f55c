"""Exported controllers at length: every kind, 10^5 steps, sanitizers, a heap nobody may touch."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
import torch

import mann_torch as mt
from tests.contracts.test_controller_contract import CONTROLLERS_TO_CHECK
from tests.contracts.test_deployed_contract import deployed

from .c_calling import NAME, InC, made, needs
from .test_c_code import deployed as stepper_of
from .test_c_code import rows

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", CONTROLLERS_TO_CHECK)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_every_controller_passes_its_test(name: str, dtype: torch.dtype, tmp_path: Path) -> None:
    tick = deployed(name, "torch")[1].tick
    try:
        stepper = mt.deployment.Stepper(tick, dtype, "compiled")
    except mt.ConfigError as error:
        pytest.skip(str(error))
    folder = stepper.to_c(tmp_path / "out", NAME, "struct", libm=False)
    for compiler in ("gcc", "clang"):
        assert "all holds" in made(folder, "clean", "test", compiler=compiler)
    assert "all holds" in made(folder, "clean", "sanitize", compiler="gcc")


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_many_steps_are_those_of_python_to_the_bit(dtype: torch.dtype, tmp_path: Path) -> None:
    stepper = stepper_of(dtype)
    c, given = InC(stepper, tmp_path / "out"), rows(100_000, dtype)
    state = own = stepper.initial_state(*given[0])
    for row in given:
        expected, found = stepper.step(state, *row), c.step(own, *row)
        state, own = expected.state, found.state
        assert torch.equal(found.input, expected.input)
    assert c.to_bytes(own) == stepper.to_bytes(state)
    assert int(stepper.unpacked(state).mode.switches) > 100


_HEAP = r"""
#include "ctl.h"
#include <stdlib.h>
#include <unistd.h>

extern void* __libc_malloc(size_t);
static volatile int armed = 0;

void* malloc(size_t size) {
  if (armed) _exit(7);
  return __libc_malloc(size);
}

int main(int count, char** words) {
  static ctl_state state;
  static unsigned char bytes[CTL_STATE_BYTES];
  static const ctl_real reference[CTL_REFERENCE] = {0.1, 0.2}, measurement[CTL_MEASUREMENT] = {0};
  ctl_real input[CTL_INPUT];
  (void)words;
  armed = 1;
  if (count > 1) return malloc(8) == NULL;
  ctl_init(&state, reference, measurement);
  for (int i = 0; i < 1000; ++i) ctl_step(&state, reference, measurement, i % 3, input);
  ctl_save(&state, bytes);
  const int refused = ctl_restore(&state, bytes);
  ctl_reset(&state, reference, measurement);
  return refused;
}
"""


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_nothing_is_allocated(compiler: str, tmp_path: Path) -> None:
    folder = stepper_of().to_c(tmp_path / "out", NAME)
    (folder / "heap.c").write_text(_HEAP)
    program = tmp_path / "heap"
    sources = [str(folder / "heap.c"), str(folder / f"{NAME}.c")]
    done = subprocess.run(
        [needs(compiler), "-O1", "-fno-builtin", *sources, "-o", str(program), "-lm"],
        capture_output=True,
        text=True,
    )
    if "__libc_malloc" in done.stderr:
        pytest.skip("this C library's malloc has no second name")
    assert done.returncode == 0, done.stderr
    assert subprocess.run([str(program), "allocate"]).returncode == 7  # it would be noticed
    assert subprocess.run([str(program)]).returncode == 0
