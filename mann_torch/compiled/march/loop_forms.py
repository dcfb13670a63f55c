"""The time loop in an arithmetic, and with constants that samples share."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ..real import FLOAT, Real
from .loop_text import BACKWARD, COMMON, FORWARD, GATHER, TOOLS

#: Place of the first of two pointers: the shared constants, and sums of their gradients.
SHARED = 32
# A step's part of a sum is added where all samples live; else it is made beside, and selected.
# Factors of outer products are kept, 0 for samples that do not live, and added now and then.
_SHARED = {
    "$W": "shared, ",
    "$SUM": "sum_shared, kept + n_kept * N_KEPT, ",
    "$COMMON": f"const double* const shared = (const double*)table[{SHARED}];\n",
    "$ROOM": f"""V* const g_shared = (V*)table[{SHARED + 1}] + (long long)g * N_WANTED_SHARED;
V* const part_shared = heap; heap += N_WANTED_SHARED;
V* const kept = heap; heap += KEEP * N_KEPT;
int n_kept = 0;
""",
    "$IN": """      V* const sum_shared = Tools::all(alive) ? g_shared : part_shared;
      if (sum_shared != g_shared) Outer::copy(part_shared, g_shared);
""",
    "$OUT": """      if (sum_shared != g_shared) {
        Outer::hold(alive, g_shared, part_shared);
        for (int e = n_kept * N_KEPT; e < (n_kept + 1) * N_KEPT; ++e)
          kept[e] = Tools::sel(alive, kept[e], Tools::splat(0.0));
      }
      if (++n_kept == KEEP) {
        Outer::add(g_shared, kept, n_kept);
        n_kept = 0;
      }
""",
    "$DONE": "Outer::add(g_shared, kept, n_kept);\n",
}


_ROWS = r"""
      for (int l = 0; l < LANES && (long long)g * LANES + l < B; ++l) {
"""
_FROM = "        const double* from = @ + (long long)g * LANES + l) * #;"
_END = "g_state, state_slot[0], B, g);\n}\n"
# Number by number -> in squares; segments, and sums of their gradients, in lanes -> as they are.
_TURNED = {
    "V* const g_segments = (V*)table[29];\n": """double* const g_segments = (double*)table[29];
V* const sum_room = heap; heap += N_WANTED_SEGMENT;
long long held_sum = -1;
""",
    "g_segments + ((long long)segment_of[s] * G + g) * N_WANTED_SEGMENT": (
        "Turn::sums(sum_room, held_sum, segment_of[s], g_segments, B, g)"
    ),
    _END: _END + "Turn::sums(sum_room, held_sum, -1, g_segments, B, g);\n",
    "const V* const segments = (const V*)": "const double* const segments = (const double*)",
    "V* const noise = heap; heap += N_NOISE;\n": """V* const noise = heap; heap += N_NOISE;
V* const segment_room = heap; heap += N_SEGMENT;
long long held_segment = -1;
""",
    "segments + ((long long)segment_of[s] * G + g) * N_SEGMENT": (
        "Turn::segment(segment_room, held_segment, segment_of[s], segments, B, g)"
    ),
    _ROWS
    + """        double* out = motion + ((long long)row * B + (long long)g * LANES + l) * N_MOTION;
        for (int e = 0; e < N_MOTION; ++e) out[e] = Watch::get(f[e], l);
      }
""": """
      Turn::out(motion + ((long long)row * B + (long long)g * LANES) * N_MOTION, f, N_MOTION,
                B - (long long)g * LANES);
""",
    _ROWS
    + """        const long long at = (long long)kept_row * B + (long long)g * LANES + l;
        for (int e = 0; e < N_F; ++e) state_f[at * N_F + e] = Watch::get(f[e], l);
""": """
      Turn::out(state_f + ((long long)kept_row * B + (long long)g * LANES) * N_F, f, N_F,
                B - (long long)g * LANES);
    if (kept_row >= 0)"""
    + _ROWS
    + """        const long long at = (long long)kept_row * B + (long long)g * LANES + l;
""",
    _ROWS
    + _FROM.replace("@", "g_motion + ((long long)row * B").replace("#", "N_MOTION")
    + """
        for (int e = 0; e < N_MOTION; ++e) put(&adj[e], l, get(adj[e], l) + from[e]);
      }
""": """
      Turn::add(adj, g_motion + ((long long)row * B + (long long)g * LANES) * N_MOTION, N_MOTION,
                B - (long long)g * LANES);
""",
    _ROWS
    + _FROM.replace("@", "g_state + ((long long)whole * B").replace("#", "N_F")
    + """
        for (int e = 0; e < N_F; ++e) put(&adj[e], l, get(adj[e], l) + from[e]);
      }
""": """
      Turn::add(adj, g_state + ((long long)whole * B + (long long)g * LANES) * N_F, N_F,
                B - (long long)g * LANES);
""",
}


_FLOAT = {"long long* const state_k = (long long*)": "int* const state_k = (int*)"}


def marched(text: str, real: Real, shared: bool) -> str:
    """Text of the loop in an arithmetic, with or without constants that samples share.

    Rows of samples are turned in squares there; not where float64 samples share none: that text,
    and what is compiled of it, stays as it is.
    """
    text = _replaced(text, _SHARED if shared else dict.fromkeys(_SHARED, ""))
    if turned(real, shared):
        text = _replaced(text, _TURNED)
    if real is FLOAT:
        text = re.sub(r"\bdouble\b", "float", _replaced(text, _FLOAT))
    return text


def _replaced(text: str, forms: Mapping[str, str]) -> str:
    for plain, other in forms.items():
        text = text.replace(plain, other)
    return text


def _check(text: str, *steps: Mapping[str, str]) -> None:
    """Raise `RuntimeError` if what is to be replaced is nowhere in the loop, as it is by then."""
    for forms in steps:
        for plain, other in forms.items():
            if plain not in text:
                raise RuntimeError(f"nothing to replace in the time loop: {plain!r}")
            text = text.replace(plain, other)


# All of it, once: a part of the loop has only some of them.
_check("\n".join((TOOLS, COMMON, FORWARD, GATHER, BACKWARD)), _SHARED, _TURNED, _FLOAT)


def turned(real: Real, shared: bool) -> bool:
    """Whether `Turn` is needed."""
    return real is FLOAT or shared
