"""The header: types, sizes, where things lie, and the functions."""

from __future__ import annotations

from collections.abc import Sequence

from ...compiled.c99 import WHOLE
from ..tick import DIVERGED, REFUSED, SATURATED
from .form import Field, Form

#: How the first line of a header begins: what tells an export of ours.
TITLE = "// A controller of mann_torch: "

_TEXT = """{title}
// README.md says what the numbers mean.
#ifndef {NAME}_H
#define {NAME}_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

typedef {real} {name}_real;
typedef {whole} {name}_whole;

#define {NAME}_PERIOD {period}  // [s], from one step to the next

enum {{
  {NAME}_REFERENCE = {reference},  // numbers in
  {NAME}_MEASUREMENT = {measurement},
  {NAME}_INPUT = {input},  // numbers out
  {NAME}_F = {n_f},  // numbers of the state
  {NAME}_K = {n_k},
  {NAME}_STATE_BYTES = {bytes}  // of a saved state
}};

// Flags of a step.
enum {{
  {NAME}_REFUSED = {REFUSED},  // what came in is not finite: nothing was done
  {NAME}_SATURATED = {SATURATED},  // the command is at a limit
  {NAME}_DIVERGED = {DIVERGED}  // what would come out is not finite: nothing was done
}};

// Where the state's parts begin, in `f` and in `k`.
enum {{
{places}
}};

typedef struct {{
  {name}_real f[{NAME}_F];
  {name}_whole k[{room_k}];
}} {name}_state;
{constants}
// The state before the first step, of what there is to follow and to see then.
void {name}_init({name}_state* state, {given}const {name}_real* reference,
    const {name}_real* measurement);

// One step: writes the command and returns flags. Without `adapt` what adapts stays as it is.
int {name}_step({name}_state* state, {given}const {name}_real* reference,
    const {name}_real* measurement, int adapt, {name}_real* input);

// Weights, memory and decisions afresh, as at the start; the command in force stays.
void {name}_reset({name}_state* state, {given}const {name}_real* reference,
    const {name}_real* measurement);

// The state as bytes: little-endian, with the mark of this controller and a checksum.
void {name}_save(const {name}_state* state, unsigned char* bytes);

// 0, or 1 for bytes of another controller and 2 for damaged ones: the state is unharmed then.
int {name}_restore({name}_state* state, const unsigned char* bytes);

#ifdef __cplusplus
}}
#endif

#endif
"""


def header(form: Form) -> str:
    """The text of `<name>.h`."""
    name = form.name
    ports = form.ports
    places = ",\n".join(
        f"  {name.upper()}_{field.array.upper()}_{field.name} = {field.offset}"
        for field in form.state
        if field.size
    )
    return _TEXT.format(
        title=TITLE + form.title,
        name=name,
        NAME=name.upper(),
        real=form.real.name,
        whole=WHOLE[form.real.bytes],
        period=repr(form.stepper.period),
        reference=len(ports.reference),
        measurement=len(ports.measurement),
        input=len(ports.input),
        n_f=form.size("f"),
        n_k=form.size("k"),
        room_k=f"{name.upper()}_K" if form.size("k") else "1",
        bytes=form.bytes,
        REFUSED=REFUSED,
        SATURATED=SATURATED,
        DIVERGED=DIVERGED,
        places=places,
        constants=_constants(form) if form.settable else "",
        given=f"const {name}_constants* constants, " if form.settable else "",
    )


def _constants(form: Form) -> str:
    """The struct that they are set in: floating numbers first, all of one width."""
    floating = [f for f in form.constants if f.array == "f" and f.size]
    others = [f for f in form.constants if f.array == "k" and f.size]
    fields = "".join(_lines(floating, f"{form.name}_real"))
    fields += "".join(_lines(others, f"{form.name}_whole"))
    return f"""
// Constants and first values; a mask is 0 or -1.
typedef struct {{
{fields}}} {form.name}_constants;

// Those that the controller was exported with.
{form.name}_constants {form.name}_default_constants(void);
"""


def _lines(fields: Sequence[Field], kind: str) -> list[str]:
    return [
        f"  {kind} {f.name}{f'[{f.size}]' if f.shape else ''};  // {f.path}{shape_text(f)}\n"
        for f in fields
    ]


def shape_text(field: Field) -> str:
    """A shape of more than one dimension, as a note."""
    return f", {' x '.join(map(str, field.shape))} by rows" if len(field.shape) > 1 else ""
