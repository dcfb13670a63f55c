"""The test program: a sequence recorded in Python, taken again in C, and what must not harm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ...compiled.cpp.expressions import number, whole
from ...trees import leaves
from ..stepper import Stepper
from .form import Form

#: Steps recorded; between these two nothing adapts, and at the first of them the state is saved.
STEPS, FROZEN, FREE = 300, 120, 160
#: By how much numbers may differ, relative to the largest of their kind: a machine without fma
#: rounds otherwise.
TOLERANCE = {8: "1e-9", 4: "2e-3"}


class Record(NamedTuple):
    """What went in and what came out, a row a step."""

    references: list[Tensor]
    measurements: list[Tensor]
    inputs: list[Tensor]
    flags: list[int]
    saved: bytes  # before step `FROZEN`
    last: Tensor  # the state after the last step


def recorded(stepper: Stepper) -> Record:
    """Steps at sines: the reference with its derivatives, outputs measured that are near it."""
    pairs = [_row(stepper, i * stepper.period) for i in range(STEPS)]
    state = stepper.initial_state(*pairs[0])
    inputs, flags, saved = [], [], b""
    for i, (reference, measurement) in enumerate(pairs):
        if i == FROZEN:
            saved = stepper.to_bytes(state)
        made = stepper.step(state, reference, measurement, adapt=not FROZEN <= i < FREE)
        state = made.state
        inputs.append(made.input)
        flags.append(made.flags)
    return Record([r for r, _ in pairs], [m for _, m in pairs], inputs, flags, saved, state)


def _row(stepper: Stepper, time: float) -> tuple[Tensor, Tensor]:
    ports, width = stepper.ports, stepper.ports.width
    reference = [
        0.8 * (1.0 + 0.3 * i) ** order
        * math.sin((1.0 + 0.3 * i) * time + 0.5 * i + 0.5 * math.pi * order)
        for order in range(ports.order + 1)
        for i in range(width)
    ]  # fmt: skip
    seen = [0.4 * math.sin((1.3 + 0.2 * i) * time + i) for i in range(len(ports.measurement))]
    for i, place in enumerate(ports.output or ()):
        seen[place] = reference[i] + 0.1 * math.sin(3.0 * time + i)
    row, other = (torch.tensor(x, dtype=torch.float64) for x in (reference, seen))
    return row.to(stepper.dtype), other.to(stepper.dtype)


_TEXT = """// Replays what the Python stepper did, and checks what must not harm: exits with 0.
#include "@.h"

#include <stdio.h>
#include <string.h>

enum { STEPS = $STEPS, FROZEN = $FROZEN, FREE = $FREE };
static const double tolerance = $TOLERANCE;

static const @_real reference[STEPS][$R] = {
$REFERENCES
};
static const @_real measurement[STEPS][$Y] = {
$MEASUREMENTS
};
static const @_real expected[STEPS][$M] = {
$INPUTS
};
static const int flags[STEPS] = {
$FLAGS
};
// The state that Python saved before the step FROZEN, and the one after the last step.
static const unsigned char saved[$BYTES] = {
$SAVED
};
static const @_real last_f[$F] = {
$LAST_F
};
static const @_real scale_f[$F] = {
$SCALE_F
};
static const @_whole last_k[$ROOM_K] = {
$LAST_K
};

static int failures = 0;
static double worst = 0.0;

static void check(int holds, const char* what) {
  if (!holds) printf("FAILED: %s\\n", what);
  failures += !holds;
}

static double apart(double a, double b, double scale) {
  const double d = a > b ? a - b : b - a;
  return scale > 0.0 ? d / scale : d;
}

static int step(@_state* state, int i, @_real* input) {
  const int adapt = i < FROZEN || i >= FREE;
  return @_step(state, $CONSTANTSreference[i], measurement[i], adapt, input);
}

static void replay(@_state* state, int first) {
  double scale[$M];
  int same_flags = 1;
  for (int m = 0; m < $M; ++m) {
    scale[m] = 0.0;
    for (int i = 0; i < STEPS; ++i) {
      const double size = apart(expected[i][m], 0.0, 0.0);
      if (size > scale[m]) scale[m] = size;
    }
  }
  for (int i = first; i < STEPS; ++i) {
    @_real input[$M];
    same_flags = same_flags && step(state, i, input) == flags[i];
    for (int m = 0; m < $M; ++m) {
      const double d = apart(input[m], expected[i][m], scale[m]);
      if (worst == worst && !(d <= worst)) worst = d;
    }
  }
  for (int e = 0; e < $F; ++e) {
    const double d = apart(state->f[e], last_f[e], scale_f[e]);
    if (worst == worst && !(d <= worst)) worst = d;
  }
  check(worst <= tolerance, "commands and state are Python's");
  check(same_flags, "flags are Python's");
  for (int e = 0; e < $K; ++e) check(state->k[e] == last_k[e], "decisions are Python's");
}

int main(void) {
  static @_state state, other, before;
  static unsigned char bytes[$BYTES], again[$BYTES];
  @_real input[$M], seen[$Y];
$DEFAULTS
  @_init(&state, $CONSTANTSreference[0], measurement[0]);
  replay(&state, 0);

  memset(&other, 0, sizeof other);
  check(@_restore(&other, saved) == 0, "a state that Python saved is taken");
  replay(&other, FROZEN);

  @_save(&state, bytes);
  memset(&other, 0, sizeof other);
  check(@_restore(&other, bytes) == 0, "a saved state is taken");
  @_save(&other, again);
  check(memcmp(bytes, again, sizeof bytes) == 0, "a restored state is the one that was saved");

  before = other;
  bytes[sizeof bytes - 9] ^= 1u;
  check(@_restore(&other, bytes) == 2, "a damaged state is refused");
  bytes[sizeof bytes - 9] ^= 1u;
  bytes[9] ^= 1u;
  check(@_restore(&other, bytes) == 1, "another controller's state is refused");
  check(memcmp(&before, &other, sizeof other) == 0, "what is refused leaves the state unharmed");

  const volatile @_real zero = 0;
  for (int y = 0; y < $Y; ++y) {
    memcpy(seen, measurement[1], sizeof seen);
    seen[y] = y % 2 ? zero / zero : 1 / zero;
    check(@_step(&other, $CONSTANTSreference[1], seen, 1, input) == $REFUSED,
          "what a sensor cannot mean is refused");
    for (int m = 0; m < $M; ++m) check(input[m] == before.f[m], "the command stays");
    check(memcmp(&before, &other, sizeof other) == 0, "a bad sensor leaves the state unharmed");
  }

  @_init(&other, $CONSTANTSreference[0], measurement[0]);
  @_reset(&state, $CONSTANTSreference[0], measurement[0]);
  for (int m = 0; m < $M; ++m) {
    check(state.f[m] == before.f[m], "a reset leaves the command in force");
    state.f[m] = other.f[m];
  }
  check(memcmp(state.f, other.f, sizeof other.f) == 0, "a reset state begins anew");
  for (int e = 0; e < $K; ++e) check(state.k[e] == other.k[e], "a reset state decides anew");

  printf("@: %d steps, largest deviation %.1e of %.0e, %s\\n", STEPS, worst, tolerance,
         failures ? "FAILED" : "all holds");
  return failures != 0;
}
"""


def replay(form: Form, record: Record) -> str:
    """The text of `test_<name>.c`."""
    name, real = form.name, form.real
    n_f, n_k = form.size("f"), form.size("k")
    f, k = record.last[:n_f], record.last[n_f:].view(real.whole_dtype)[:n_k]
    kept = [x for x in leaves(form.stepper.unpacked(record.last)) if x.is_floating_point()]
    scale = torch.cat(
        [x.abs().max().expand(x.numel()) if x.numel() else x.reshape(-1) for x in kept]
    )
    places = {
        "$CONSTANTS": "&constants, " if form.settable else "",
        "$DEFAULTS": f"  constants = {name}_default_constants();\n" if form.settable else "",
        "$STEPS": str(STEPS),
        "$FROZEN": str(FROZEN),
        "$FREE": str(FREE),
        "$TOLERANCE": TOLERANCE[real.bytes],
        "$REFERENCES": _table(record.references, form),
        "$MEASUREMENTS": _table(record.measurements, form),
        "$INPUTS": _table(record.inputs, form),
        "$FLAGS": _lines([str(x) for x in record.flags], 20),
        "$SAVED": _lines([str(b) for b in record.saved], 20),
        "$LAST_F": _lines(_numbers(f, form), 4),
        "$SCALE_F": _lines(_numbers(scale, form), 4),
        "$LAST_K": _lines([whole(str(v)) for v in k.tolist()] or ["0"], 8),
        "$ROOM_K": str(max(n_k, 1)),
        "$REFUSED": f"{name.upper()}_REFUSED",
        "$BYTES": f"{name.upper()}_STATE_BYTES",
        "$R": f"{name.upper()}_REFERENCE",
        "$Y": f"{name.upper()}_MEASUREMENT",
        "$M": f"{name.upper()}_INPUT",
        "$F": f"{name.upper()}_F",
        "$K": f"{name.upper()}_K",
    }
    text = _TEXT
    if form.settable:
        text = text.replace(
            "static int failures", f"static {name}_constants constants;\nstatic int failures"
        )
    for place, value in places.items():
        text = text.replace(place, value)
    return text.replace("@", name)


def _numbers(row: Tensor, form: Form) -> list[str]:
    return [number(repr(v), form.real) for v in row.tolist()]


def _table(rows: Sequence[Tensor], form: Form) -> str:
    return ",\n".join(f"  {{{', '.join(_numbers(row, form))}}}" for row in rows)


def _lines(values: Sequence[str], width: int) -> str:
    parts = [values[i : i + width] for i in range(0, len(values), width)]
    return ",\n".join("  " + ", ".join(part) for part in parts)
