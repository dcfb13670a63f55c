"""The source: the compiled engine's texts of start and step, and the functions around them."""

from __future__ import annotations

import torch

from ...compiled.c99 import c99_file, c99_literals, constants_in
from ...compiled.cpp.expressions import number, whole
from ...compiled.real import DOUBLE
from ..blob import MAGIC
from .form import Form
from .header import TITLE

_AROUND = """
void @_init(@_state* state, $GIVENconst @_real* reference,
    const @_real* measurement) {
$BEGIN}

int @_step(@_state* state, $GIVENconst @_real* reference,
    const @_real* measurement, int adapt, @_real* input) {
$ARRAYS  @_real in[$R + $Y + 1], f[$F];
  @_whole k[$K + 1];
  for (int i = 0; i < $R; ++i) in[i] = reference[i];
  for (int i = 0; i < $Y; ++i) in[$R + i] = measurement[i];
  in[$R + $Y] = adapt ? 1 : 0;
  @_advance($PASSED);
  const int flags = (int)k[$K];
  if (!(flags & ($REFUSED | $DIVERGED))) {
    for (int i = 0; i < $F; ++i) state->f[i] = f[i];
    for (int i = 0; i < $K; ++i) state->k[i] = k[i];
  }
  for (int i = 0; i < $M; ++i) input[i] = state->f[i];
  return flags;
}

void @_reset(@_state* state, $GIVENconst @_real* reference,
    const @_real* measurement) {
  @_real input[$M];
  for (int i = 0; i < $M; ++i) input[i] = state->f[i];
  @_init(state, $HANDEDreference, measurement);
  for (int i = 0; i < $M; ++i) state->f[i] = input[i];
}

static const unsigned char @_mark[16] = {
$MARK
};

static void @_put(unsigned char* bytes, uint64_t value, int count) {
  for (int i = 0; i < count; ++i) bytes[i] = (unsigned char)(value >> (8 * i) & 255u);
}

static uint64_t @_take(const unsigned char* bytes, int count) {
  uint64_t value = 0;
  for (int i = 0; i < count; ++i) value |= (uint64_t)bytes[i] << (8 * i);
  return value;
}

// FNV-1a.
static uint64_t @_checksum(const unsigned char* bytes) {
  uint64_t sum = 0xcbf29ce484222325ULL;
  for (int i = 0; i < $BYTES - 8; ++i) sum = (sum ^ bytes[i]) * 0x100000001b3ULL;
  return sum;
}

void @_save(const @_state* state, unsigned char* bytes) {
  union { @_real number; $BITS bits; } u;
  for (int i = 0; i < 16; ++i) bytes[i] = @_mark[i];
  unsigned char* at = bytes + 16;
  for (int i = 0; i < $F; ++i, at += $WIDTH) {
    u.number = state->f[i];
    @_put(at, u.bits, $WIDTH);
  }
  for (int i = 0; i < $K; ++i, at += $WIDTH) @_put(at, ($BITS)state->k[i], $WIDTH);
  @_put(at, @_checksum(bytes), 8);
}

int @_restore(@_state* state, const unsigned char* bytes) {
  union { @_real number; $BITS bits; } u;
  for (int i = 0; i < 16; ++i)
    if (bytes[i] != @_mark[i]) return 1;
  if (@_take(bytes + $BYTES - 8, 8) != @_checksum(bytes)) return 2;
  const unsigned char* at = bytes + 16;
  for (int i = 0; i < $F; ++i, at += $WIDTH) {
    u.bits = ($BITS)@_take(at, $WIDTH);
    state->f[i] = u.number;
  }
  for (int i = 0; i < $K; ++i, at += $WIDTH) state->k[i] = (@_whole)@_take(at, $WIDTH);
  return 0;
}
"""


def source(form: Form) -> str:
    """The text of `<name>.c`."""
    name = form.name
    places = {
        "$BEGIN": _begin(form),
        "$GIVEN": f"const {name}_constants* constants, " if form.settable else "",
        "$HANDED": "constants, " if form.settable else "",
        "$ARRAYS": _arrays(form) if form.settable else "",
        "$PASSED": ("constant, " if form.settable else "")
        + ("in, whole, " if form.settable else "in, ")
        + "state->f, state->k, f, k",
        "$MARK": "  " + ", ".join(str(b) for b in MAGIC + form.stepper.blob.mark),
        "$REFUSED": f"{name.upper()}_REFUSED",
        "$DIVERGED": f"{name.upper()}_DIVERGED",
        "$BYTES": f"{name.upper()}_STATE_BYTES",
        "$BITS": f"uint{8 * form.real.bytes}_t",
        "$WIDTH": str(form.real.bytes),
        "$R": f"{name.upper()}_REFERENCE",
        "$Y": f"{name.upper()}_MEASUREMENT",
        "$M": f"{name.upper()}_INPUT",
        "$F": f"{name.upper()}_F",
        "$K": f"{name.upper()}_K",
    }
    around = _AROUND
    for place, text in places.items():
        around = around.replace(place, text)
    head = f'{TITLE}{form.title}\n#include "{name}.h"\n'
    body = c99_file(form.units, f"{name}_m_", form.libm)
    return "\n".join([head, _constants(form), body, around.replace("@", name)])


_DEFAULTS = """
typedef char @_constants_are_packed[sizeof(@_constants) == $N * sizeof(@_real) ? 1 : -1];

@_constants @_default_constants(void) {
  static const @_constants defaults = {
$VALUES
  };
  return defaults;
}
"""


def _constants(form: Form) -> str:
    """Constants as arrays of the file, those that are read; or the struct's values."""
    name = form.name
    if form.settable:
        fields = [f for f in form.constants if f.size]
        ordered = [f for f in fields if f.array == "f"] + [f for f in fields if f.array == "k"]
        values = ",\n".join(f"    {_value(form, f.path, bool(f.shape))}" for f in ordered)
        text = _DEFAULTS.replace("$VALUES", values).replace("$N", str(sum(f.size for f in fields)))
        return text.replace("@", name)
    text = "\n".join(unit.text for unit in form.units)
    found = []
    first, own = form.baked
    sets = {first: (form.start, form.stepper.exact), own: (form.step, form.stepper.values)}
    for prefix, (program, held) in sets.items():
        given = program.given
        arrays = ("constant", "whole")
        for array, numbers in zip(arrays, constants_in(given, [*held.values()]), strict=True):
            if f"{prefix}{array}[" in text:
                found.append(c99_literals(prefix + array, numbers, given.real))
    return "\n".join(found)


def _value(form: Form, path: str, many: bool) -> str:
    x = form.stepper.values[path]
    if x.is_floating_point():
        texts = [number(repr(v), form.real) for v in x.reshape(-1).tolist()]
    else:
        sign = -1 if x.dtype == torch.bool else 1
        texts = [whole(str(sign * int(v))) for v in x.reshape(-1).tolist()]
    return f"{{{', '.join(texts)}}}" if many else texts[0]


def _arrays(form: Form, indent: str = "  ") -> str:
    """The struct of constants as the two arrays that the functions take."""
    return (
        f"{indent}const @_real* const constant = (const @_real*)(const void*)constants;\n"
        f"{indent}const @_whole* const whole =\n"
        f"{indent}    (const @_whole*)(const void*)(constant + {form.count('f')});\n"
    )


def _begin(form: Form) -> str:
    """The body of `init`: a start is computed in float64 whatever the steps are."""
    lines = [_arrays(form)] if form.settable else []
    wide = form.real is not DOUBLE
    given = "constant, in, whole, " if form.settable else "in, "
    lines.append("  double in[$R + $Y];\n")
    if wide:
        lines.append(f"  double f[$F];\n  int64_t k[{form.size('k') or 1}];\n")
        if form.settable:
            lines.append(_widened("first", "double", "constant", form.count("f")))
            lines.append(_widened("others", "int64_t", "whole", form.count("k")))
            given = "first, in, others, "
    lines.append("  for (int i = 0; i < $R; ++i) in[i] = reference[i];\n")
    lines.append("  for (int i = 0; i < $Y; ++i) in[$R + i] = measurement[i];\n")
    out = "f, k" if wide else "state->f, state->k"
    lines.append(f"  @_begin({given}0, 0, {out});\n")
    if wide:
        lines.append("  for (int i = 0; i < $F; ++i) state->f[i] = (@_real)f[i];\n")
        lines.append("  for (int i = 0; i < $K; ++i) state->k[i] = (@_whole)k[i];\n")
    return "".join(lines)


def _widened(name: str, kind: str, source: str, count: int) -> str:
    if not count:
        return f"  {kind} {name}[1] = {{0}};\n  (void){source};\n"
    return (
        f"  {kind} {name}[{count}];\n  for (int i = 0; i < {count}; ++i) {name}[i] = {source}[i];\n"
    )
