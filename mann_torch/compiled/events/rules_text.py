"""C++ text that the forward and the backward skeleton share: event functions, choices by lane.

The rules are those of `simulation/events`, line for line; it says what they mean.
"""

from .rules import FLAT, GRAZE, ITERATIONS, ROUNDING, STENCIL, TIE, WIDTH

#: What a step leaves for its gradient, integers of the carry: the last two are bits of numbers.
NOTES = ("KIND", "DUE", "ATTENDED_THEN", "NUMBER", "NEXT", "ROOT", "SLOPE")
#: Bits of KIND.
SLID, LOCATED = 1, 2
#: What is counted.
COUNTS = ("LOCATED", "SLIDING", "UNRESOLVED")


def numbers(n_slots: int, attended: int, switches: int, counts: int, notes: int) -> dict[str, int]:
    """Names of places in `k` and of sizes."""
    return {
        "N_SLOTS": n_slots,
        "N_EVENTS": n_slots + 1,
        "K_ATTENDED": attended,
        "K_SWITCHES": switches,
        **{f"K_N_{name}": counts + i for i, name in enumerate(COUNTS)},
        **{f"K_{name}": notes + i for i, name in enumerate(NOTES)},
        "SLID": SLID,
        "LOCATED": LOCATED,
        "ITERATIONS": ITERATIONS,
    }


RULES = (
    f"""
struct Rules : Lanes {{
  static inline CUDA_CALLABLE V tie() {{ return splat({TIE.hex()}); }}
  static inline CUDA_CALLABLE V graze() {{ return splat({GRAZE.hex()}); }}
  static inline CUDA_CALLABLE V flat() {{ return splat({FLAT.hex()}); }}
  static inline CUDA_CALLABLE V stencil() {{ return splat({STENCIL.hex()}); }}
  static inline CUDA_CALLABLE V width() {{ return splat({WIDTH.hex()}); }}
  static inline CUDA_CALLABLE V rounding() {{ return splat({ROUNDING.hex()}); }}
"""
    + """
  // What a step is given, whatever is asked of it.
  struct Scene {
    const double* clock; const V* constant; const V* segment; const V* noise; const M* whole;
    V* heap;
  };
  static inline CUDA_CALLABLE void held(const Scene& s, V t, V h, const V* weights, const V* f,
                                        const M* k, V* f_out) {
    const V moment[2] = {t, h};
    Held::run(moment, weights, s.clock, s.constant, s.segment, s.noise, s.whole, f, k, f_out,
              (M*)0, s.heap);
  }
  // Distances of the slots and the reset's margin.
  static inline CUDA_CALLABLE void near(const Scene& s, V t, const V* f, const M* k, V* found) {
    const V moment[1] = {t};
    Near::run(moment, s.clock, s.constant, s.segment, s.noise, s.whole, f, k, (V*)0, (M*)0, found,
              s.heap);
  }
  static inline CUDA_CALLABLE void reset(const Scene& s, V t, const V* f, const M* k, V* f_out,
                                         M* k_out) {
    const V moment[1] = {t};
    Reset::run(moment, s.clock, s.constant, s.segment, s.noise, s.whole, f, k, f_out, k_out,
               s.heap);
  }
  static inline CUDA_CALLABLE V at(const V* x, M index) {
    V found = splat(0.0);
    for (int j = 0; j < N_EVENTS; ++j) found = sel(ieq(index, isplat(j)), x[j], found);
    return found;
  }
  static inline CUDA_CALLABLE void branch(V* weights, M index) {
    for (int j = 0; j < N_SLOTS; ++j) weights[j] = mask_to_double(ieq(index, isplat(j)));
  }
  // D_s - D_j for each slot j, -inf for s itself; the margin stays.
  static inline CUDA_CALLABLE void events(V* g, M attended) {
    const V own = at(g, attended);
    for (int j = 0; j < N_SLOTS; ++j)
      g[j] = sel(ieq(attended, isplat(j)), -inf_(), own - g[j]);
  }
  static inline CUDA_CALLABLE V largest(const V* g, const M* crossed) {
    V found = -inf_();
    for (int j = 0; j < N_EVENTS; ++j)  // as torch: no number stays none
      found = sel(crossed[j] & (gt(g[j], found) | ne(g[j], g[j])), g[j], found);
    return found;
  }
  static inline CUDA_CALLABLE M which(const V* g, const M* crossed) {
    V best = -inf_(); M found = isplat(0);
    for (int j = 0; j < N_EVENTS; ++j) {
      const M more = crossed[j] & gt(g[j], best);
      best = sel(more, g[j], best);
      found = isel(more, isplat(j), found);
    }
    return found;
  }
  // The nearest slot, or the one that was attended while another is no nearer than by a tie.
  static inline CUDA_CALLABLE M attend(const V* distances, M before) {
    V best = distances[0]; M nearest = isplat(0);
    for (int j = 1; j < N_SLOTS; ++j) {
      const M nearer = lt(distances[j], best) | (ne(distances[j], distances[j]) & eq(best, best));
      best = sel(nearer, distances[j], best);
      nearest = isel(nearer, isplat(j), nearest);
    }
    const M known = ige(before, isplat(0));
    const V now = at(distances, isel(known, before, isplat(0)));
    return isel(known & le(now - best, tie()), before, nearest);
  }
  static inline CUDA_CALLABLE void attending(M* k, M attended) {
    const M before = k[K_ATTENDED];
    k[K_SWITCHES] += ine(attended, before) & ige(before, isplat(0)) & isplat(1);
    k[K_ATTENDED] = attended;
  }
  static inline CUDA_CALLABLE void take(M mask, V* to, const V* from, int count) {
    for (int e = 0; e < count; ++e) to[e] = sel(mask, from[e], to[e]);
  }
  static inline CUDA_CALLABLE void itake(M mask, M* to, const M* from) {
    for (int e = 0; e < N_K; ++e) to[e] = isel(mask, from[e], to[e]);
  }
};
"""
)
