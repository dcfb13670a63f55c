"""Programs that take recorded ticks one by one and time each: of the C code, and of AOTInductor's
package in C++. What they read and write are files of numbers as they lie in memory.
"""

from __future__ import annotations

import platform
import subprocess
from pathlib import Path

import torch

#: Of both: the clock, and files.
_SHARED = """
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

static void transfer(const char* name, int out, void* data, size_t bytes) {
  FILE* file = fopen(name, out ? "wb" : "rb");
  size_t done = 0;
  if (file) {
    done = out ? fwrite(data, 1, bytes, file) : fread(data, 1, bytes, file);
    fclose(file);
  }
  if (done != bytes) {
    fprintf(stderr, "%s: %zu bytes of %zu\\n", name, done, bytes);
    exit(1);
  }
}
"""
_C = """
#define _POSIX_C_SOURCE 200809L
#include "controller.h"
@SHARED@
enum { TICKS = @TICKS@ };
static controller_real reference[TICKS][CONTROLLER_REFERENCE];
static controller_real measurement[TICKS][CONTROLLER_MEASUREMENT];
static double took[TICKS], before[TICKS];
static unsigned char bytes[CONTROLLER_STATE_BYTES];

int main(void) {
  static controller_state state;
  controller_real input[CONTROLLER_INPUT];
  int flags = 0;
  transfer("reference", 0, reference, sizeof reference);
  transfer("measurement", 0, measurement, sizeof measurement);
  transfer("state", 0, bytes, sizeof bytes);
  if (controller_restore(&state, bytes)) return 2;
  for (int i = 0; i < TICKS; ++i) {
    before[i] = now();
    flags |= controller_step(&state, reference[i], measurement[i], 1, input);
    took[i] = now() - before[i];
  }
  transfer("took", 1, took, sizeof took);
  transfer("input", 1, input, sizeof input);
  return flags ? 3 : 0;
}
"""
_CPP = """
#include <torch/csrc/inductor/aoti_package/model_package_loader.h>
#include <ATen/Parallel.h>
#include <c10/core/InferenceMode.h>
#include <c10/util/irange.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/ones.h>
@SHARED@
static at::Tensor from(const char* name, std::vector<int64_t> sizes, at::ScalarType kind) {
  at::Tensor made = at::empty(sizes, kind);
  transfer(name, 0, made.data_ptr(), made.nbytes());
  return made;
}

int main() {
  c10::InferenceMode mode;
  at::set_num_threads(1);
  torch::inductor::AOTIModelPackageLoader loader("controller.pt2", "model", true);
  const int ticks = @TICKS@;
  at::Tensor reference = from("reference", {ticks, @R@}, at::kDouble);
  at::Tensor measurement = from("measurement", {ticks, @Y@}, at::kDouble);
  at::Tensor f = from("state_f", {@F@}, at::kDouble), k = from("state_k", {@K@}, at::kLong);
  const at::Tensor adapt = at::ones({}, at::kBool);
  std::vector<double> took(ticks);
  std::vector<at::Tensor> out;
  for (int i = 0; i < ticks; ++i) {
    const std::vector<at::Tensor> given = {f, k, reference[i], measurement[i], adapt};
    const double before = now();
    out = loader.run(given);
    took[i] = now() - before;
    f = out[2];
    k = out[3];
  }
  transfer("took", 1, took.data(), took.size() * sizeof(double));
  transfer("input", 1, out[0].data_ptr(), out[0].nbytes());
  return 0;
}
"""


class BuildError(RuntimeError):
    """A program could not be compiled, or ended badly; the message is its last line."""


def c_program(ticks: int) -> str:
    """Text of the program around `controller.h`."""
    return _C.replace("@SHARED@", _SHARED).replace("@TICKS@", str(ticks)).lstrip()


def cpp_program(ticks: int, sizes: dict[str, int]) -> str:
    """Text of the program around `controller.pt2`, whose R, Y, F and K are `sizes`."""
    text = _CPP.replace("@SHARED@", _SHARED)
    for name, value in {"TICKS": ticks, **sizes}.items():
        text = text.replace(f"@{name}@", str(value))
    return text.lstrip()


def torch_flags() -> list[str]:
    """What g++ needs to compile and link against the libtorch that Python has."""
    from torch.utils.cpp_extension import include_paths, library_paths

    flags = [f"-I{path}" for path in include_paths()]
    for path in library_paths():
        flags += [f"-L{path}", f"-Wl,-rpath,{path}"]
    abi = int(torch.compiled_with_cxx11_abi())
    return [*flags, f"-D_GLIBCXX_USE_CXX11_ABI={abi}", "-ltorch_cpu", "-ltorch", "-lc10"]


def ran(folder: Path, *command: str) -> str:
    """What a command says in a folder. Raises `BuildError`."""
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    except OSError as error:
        raise BuildError(f"{command[0]}: {error.strerror}") from None
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise BuildError(lines[-1] if lines else f"{command[0]}: exit code {done.returncode}")
    return done.stdout


def version(compiler: str) -> str:
    """As it calls itself: gcc 12.2.0, x86_64."""
    return f"{compiler} {ran(Path(), compiler, '-dumpfullversion').strip()}, {platform.machine()}"
