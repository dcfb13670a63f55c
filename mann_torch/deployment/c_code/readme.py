"""The README: what the numbers are, where the state's parts lie, how to compile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from torch import Tensor

from ...types import Channel
from .form import Field, Form
from .makefile import FLAGS

#: What the paper calls constants and states of its controller.
SYMBOLS = {
    "write_gain": "c_w", "shift_threshold": "theta", "key_rate": "c_k", "error_gain": "Lambda",
    "base_gain": "K_v", "robust_gain": "k_v", "weight_bound": "Z_m", "rate_W": "C_w",
    "rate_V": "C_v", "e_modification": "kappa", "W": "W", "b_w": "b_w", "V": "V", "b_v": "b_v",
    "mu": "mu", "keys": "k", "initial_V": "V(0)", "initial_b_v": "b_v(0)", "initial_mu": "mu(0)",
    "initial_keys": "k(0)",
}  # fmt: skip
#: Numbers of a constant that are shown.
_FEW = 4
#: Of what is kept, by the first part of its path.
_KINDS = {
    "input": "command in force",
    "controller": "state",
    "mode": "decision",
    "rates": "rate of the state at the last step",
    "decay": "how fast that forgets, at the last step [1/s]",
    "begun": "whether there was a step",
    "model": "state of the reference model",
    "model_rates": "its rate at the last step",
}


class Measured(NamedTuple):
    """What a compiler made of the source."""

    compiler: str
    code: int
    constants: int
    data: int
    stack: int


_TEXT = """# {title}

Written by mann_torch (`Stepper.to_c`) from the program that its compiled engine runs: C99, no
allocation, no recursion, no global data that changes. Numbers are `{real}`, integers {whole}-bit.

Call `{name}_step` every **{period} s**. It takes what is followed and what is measured, writes the
command, and moves the state by one period.

```c
#include "{name}.h"

{name}_state state;{set}
{name}_init(&state, {given}reference, measurement);   // at the first instant
for (;;) {{                                            // every {period} s
  int flags = {name}_step(&state, {given}reference, measurement, adapt, input);
}}
```

- `adapt` = 0 holds weights and memory; the controller goes on.
- `{name}_reset` starts weights and memory afresh; the command in force stays.
- `{name}_save` and `{name}_restore` keep the state as {bytes} bytes, the same as
  `Stepper.to_bytes`: magic, mark of the controller, numbers, checksum, little-endian. Restoring
  returns 0, or 1 for another controller's bytes and 2 for damaged ones, and then the state is
  unharmed.
- Arrays have the lengths below. A state is used by one thread at a time; several states may be.

## Flags

| bit | name | means |
|---|---|---|
| 1 | `{NAME}_REFUSED` | what came in is not finite: state as it was, command the last one |
| 2 | `{NAME}_SATURATED` | the command is at a limit of the actuator |
| 4 | `{NAME}_DIVERGED` | what would come out is not finite: likewise |

## Numbers in and out

`reference`, {R} numbers:

{references}

`measurement`, {Y} numbers:

{measurements}

`input`, {M} numbers:

{inputs}

## State

`state.f` has {F} numbers, `state.k` {K} integers; a mask is 0 or -1. Matrices lie by rows.

{state}

## Constants

{constants_text}

{constants}

## To compile

`make test` compiles with `$(CC)`, replays {steps} steps that were recorded in Python and checks
that saving, restoring, resetting, freezing and NaN do no harm; `make sanitize` does it under the
sanitizers. By hand:

    cc -O2 {flags} -c {name}.c

- `-ffp-contract=off`: the text says where products and sums are fused. On a machine with fused
  multiply-add ({native}) a step from the same state is
  Python's to the bit; without, sums of products are rounded twice, and only where an elementary
  function needs a product's error it is computed: the numbers agree to rounding.
- {libm_text}
- `-ffast-math` is refused. Shifting a negative integer to the right must keep its sign, as gcc's
  and clang's does.
{measured}"""

_LIBM = {
    True: "It links <math.h>: square roots, rounding, and sin, cos, tan beyond 1e9.",
    False: "It links nothing, <math.h> neither: sin, cos and tan beyond 1e9 and a remainder beyond "
    "a quotient of 2^52 are NaN, and so is what comes of them: flag `DIVERGED`.",
}


def readme(form: Form, steps: int, measured: Sequence[Measured] = ()) -> str:
    """Its text."""
    ports, name = form.ports, form.name
    settable = form.settable
    return _TEXT.format(
        title=form.title, name=name, NAME=name.upper(), real=form.real.name,
        whole=8 * form.real.bytes, period=repr(form.stepper.period), bytes=form.bytes,
        set=f"\n{name}_constants constants = {name}_default_constants();" if settable else "",
        given="&constants, " if settable else "",
        R=len(ports.reference), Y=len(ports.measurement), M=len(ports.input),
        references=_channels(ports.reference), measurements=_channels(ports.measurement),
        inputs=_channels(ports.input), F=form.size("f"), K=form.size("k"),
        state=_rows(form.state, form), constants=_rows(form.constants, None, form.stepper.values),
        constants_text=_constants_text(form), steps=steps, flags=" ".join(FLAGS),
        native="x86: `-mfma` or `-march=native`; aarch64: always",
        libm_text=_LIBM[form.libm], measured=_measured(measured),
    )  # fmt: skip


def _channels(channels: Sequence[Channel]) -> str:
    lines = ["| index | what | unit |", "|---|---|---|"]
    return "\n".join(
        [*lines, *(f"| {i} | {c.name} | {c.unit or '-'} |" for i, c in enumerate(channels))]
    )


def _rows(
    fields: Sequence[Field], form: Form | None, values: Mapping[str, Tensor] | None = None
) -> str:
    """A table of tensors and their places in the state of a form, or their values."""
    values, state = values or {}, form is not None
    head = "| place | offset | what | shape | symbol |" if state else (
        "| what | name in C | shape | exported with | symbol |"
    )  # fmt: skip
    lines = [head, "|---" * (head.count("|") - 1) + "|"]
    for field in fields:
        if not field.size:
            continue
        shape = " x ".join(map(str, field.shape)) or "1"
        symbol = SYMBOLS.get(field.path.split(".")[-1], "")
        if form is not None:
            own = field.path.startswith(("controller.", "mode."))
            symbol = symbol if own else ""
            macro = f"{form.name.upper()}_{field.array.upper()}_{field.name}"
            kind = _KINDS.get(field.path.split(".")[0], "")
            lines.append(
                f"| `{field.array}[{macro}]` | {field.offset} | {field.path}: {kind} | {shape} "
                f"| {symbol} |"
            )
        else:
            few = ", ".join(f"{float(v):.9g}" for v in values[field.path].reshape(-1)[: _FEW + 1])
            value = few if field.size <= _FEW else "..."
            lines.append(f"| {field.path} | `{field.name}` | {shape} | {value} | {symbol} |")
    return "\n".join(lines)


def _constants_text(form: Form) -> str:
    if form.settable:
        return (
            f"They are given at each call: fill `{form.name}_constants`, or take "
            f"`{form.name}_default_constants()`, those that were exported, and change some. "
            "Nothing checks them. First values (`initial_...`) are read by `init` and `reset`."
        )
    return (
        "They are baked into the code, and folded into it; for constants to be set at run time "
        'export with `constants="struct"`.'
    )


def _measured(found: Sequence[Measured]) -> str:
    if not found:
        return ""
    lines = [
        "\nIn bytes, measured when it was written:\n",
        "| compiler | code | constants | data | stack of a step |",
        "|---|---|---|---|---|",
        *(f"| {m.compiler} | {m.code} | {m.constants} | {m.data} | {m.stack} |" for m in found),
    ]
    return "\n".join(lines) + "\n"
