"""The time loop in an arithmetic, and with constants that samples share."""

from __future__ import annotations

import re

from ..real import FLOAT, Real

#: Place of the first of two pointers: the shared constants, and sums of their gradients.
SHARED = 32
# A step's part of a sum is added where all samples live; else it is made beside, and selected.
_SHARED = {
    "$W": "shared, ",
    "$SUM": "sum_shared, ",
    "$COMMON": f"const double* const shared = (const double*)table[{SHARED}];\n",
    "$ROOM": f"""V* const g_shared = (V*)table[{SHARED + 1}] + (long long)g * N_WANTED_SHARED;
V* const part_shared = heap; heap += N_WANTED_SHARED;
""",
    "$IN": """      V* const sum_shared = Tools::all(alive) ? g_shared : part_shared;
      if (sum_shared != g_shared)
        for (int e = 0; e < N_WANTED_SHARED; ++e) part_shared[e] = g_shared[e];
""",
    "$OUT": """      if (sum_shared != g_shared)
        for (int e = 0; e < N_WANTED_SHARED; ++e)
          g_shared[e] = Tools::sel(alive, part_shared[e], g_shared[e]);
""",
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
        for (int e = 0; e < N_MOTION; ++e) put(adj[e], l, get(adj[e], l) + from[e]);
      }
""": """
      Turn::add(adj, g_motion + ((long long)row * B + (long long)g * LANES) * N_MOTION, N_MOTION,
                B - (long long)g * LANES);
""",
    _ROWS
    + _FROM.replace("@", "g_state + ((long long)whole * B").replace("#", "N_F")
    + """
        for (int e = 0; e < N_F; ++e) put(adj[e], l, get(adj[e], l) + from[e]);
      }
""": """
      Turn::add(adj, g_state + ((long long)whole * B + (long long)g * LANES) * N_F, N_F,
                B - (long long)g * LANES);
""",
}


def marched(text: str, real: Real, shared: bool) -> str:
    """Text of the loop in an arithmetic, with or without constants that samples share.

    Rows of samples are turned in squares there; not where float64 samples share none: that text,
    and what is compiled of it, stays as it is.
    """
    for name, more in _SHARED.items():
        text = text.replace(name, more if shared else "")
    if turned(real, shared):
        for plain, square in _TURNED.items():
            text = text.replace(plain, square)
    if real is FLOAT:
        text = re.sub(r"\bdouble\b", "float", text)
        text = re.sub(
            r"long long\* const state_k = \(long long\*\)", "int* const state_k = (int*)", text
        )
    return text


def turned(real: Real, shared: bool) -> bool:
    """Whether `Turn` is needed."""
    return real is FLOAT or shared
