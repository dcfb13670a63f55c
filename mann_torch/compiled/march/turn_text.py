"""C++ text that turns rows, one a sample, into vectors of lanes, and back: squares in registers."""

from __future__ import annotations

_TEXT = r"""
struct Turn : Lanes {
  // LANES vectors as a square: what was lane j of vector i is lane i of vector j.
  static inline CUDA_CALLABLE void square(V* x) {
$SQUARE  }
  // Rows of n numbers, `wide` apart, from n vectors, for the first `live` lanes.
  static inline CUDA_CALLABLE void out(double* rows, const V* f, int n, long long live, int wide) {
    int first = 0;
    if (LANES > 1 && live >= LANES)
      for (; first + LANES <= n; first += LANES) {
        V x[LANES];
        #pragma unroll
        for (int l = 0; l < LANES; ++l) x[l] = f[first + l];
        square(x);
        #pragma unroll
        for (int l = 0; l < LANES; ++l)
          memcpy(rows + (long long)l * wide + first, x + l, sizeof(V));
      }
    for (int l = 0; l < LANES && l < live; ++l)
      for (int e = first; e < n; ++e) rows[(long long)l * wide + e] = get(f[e], l);
  }
  static inline CUDA_CALLABLE void out(double* rows, const V* f, int n, long long live) {
    out(rows, f, n, live, n);
  }
  // The inverse: the last sample's numbers where lanes are left over.
  static inline CUDA_CALLABLE void in(V* f, const double* rows, int n, long long live,
                                      int wide) {
    int first = 0;
    if (live >= LANES)
      for (; first + LANES <= n; first += LANES) {
        V x[LANES];
        #pragma unroll
        for (int l = 0; l < LANES; ++l)
          memcpy(x + l, rows + (long long)l * wide + first, sizeof(V));
        square(x);
        #pragma unroll
        for (int l = 0; l < LANES; ++l) f[first + l] = x[l];
      }
    for (int l = 0; l < LANES; ++l) {
      const double* const own = rows + (l < live ? l : live - 1) * wide;
      for (int e = first; e < n; ++e) put(&f[e], l, own[e]);
    }
  }
  // Row `row` of the segments as lanes.
  static inline CUDA_CALLABLE const V* segment(V* room, long long& held, long long row,
                                               const double* segments, long long B, int g) {
    const double* const rows = segments + (row * B + (long long)g * LANES) * N_SEGMENT;
    if (LANES == 1) return (const V*)rows;
    if (held != row) in(room, rows, N_SEGMENT, B - (long long)g * LANES, N_SEGMENT);
    held = row;
    return room;
  }
  // Where the gradient to row `row` is summed; the row before goes where it belongs. -1: no more.
  static inline CUDA_CALLABLE V* sums(V* room, long long& held, long long row, double* segments,
                                      long long B, int g) {
    const int n = N_WANTED_SEGMENT, wide = N_WIDE_SEGMENT;
    double* const rows = segments + (long long)g * LANES * wide;
    if (LANES == 1) return (V*)(rows + row * B * wide);
    const long long live = B - (long long)g * LANES;
    if (held == row) return room;
    if (held >= 0) out(rows + held * B * wide, room, n, live, wide);
    if (row >= 0) in(room, rows + row * B * wide, n, live, wide);
    held = row;
    return room;
  }
  static inline CUDA_CALLABLE void add(V* f, const double* rows, int n, long long live) {
    int first = 0;
    if (LANES > 1 && live >= LANES)
      for (; first + LANES <= n; first += LANES) {
        V x[LANES];
        #pragma unroll
        for (int l = 0; l < LANES; ++l) memcpy(x + l, rows + (long long)l * n + first, sizeof(V));
        square(x);
        #pragma unroll
        for (int l = 0; l < LANES; ++l) f[first + l] = f[first + l] + x[l];
      }
    for (int l = 0; l < LANES && l < live; ++l)
      for (int e = first; e < n; ++e) put(&f[e], l, get(f[e], l) + rows[(long long)l * n + e]);
  }
};
"""


def turn_text(lanes: int) -> str:
    """`Turn::out` and `Turn::add`."""
    lines, size = [], lanes // 2
    while size:
        low = ", ".join(str(lanes + j - size if j & size else j) for j in range(lanes))
        high = ", ".join(str(lanes + j if j & size else j + size) for j in range(lanes))
        for i in (i for i in range(lanes) if not i & size):
            a, b = f"x[{i}]", f"x[{i + size}]"
            lines.append(f"    {{ const V a = {a}, b = {b};")
            lines.append(f"      {a} = __builtin_shufflevector(a, b, {low});")
            lines.append(f"      {b} = __builtin_shufflevector(a, b, {high}); }}")
        size //= 2
    return _TEXT.replace("$SQUARE", "".join(f"{line}\n" for line in lines))
