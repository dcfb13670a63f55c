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


def marched(text: str, real: Real, shared: bool) -> str:
    """Text of the loop in an arithmetic, with or without constants that samples share."""
    for name, more in _SHARED.items():
        text = text.replace(name, more if shared else "")
    if real is FLOAT:
        text = re.sub(r"\bdouble\b", "float", text)
        text = re.sub(
            r"long long\* const state_k = \(long long\*\)", "int* const state_k = (int*)", text
        )
    return text
