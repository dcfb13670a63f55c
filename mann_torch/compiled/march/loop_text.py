"""The time loop around a step, in C++: forwards with its outputs, and backwards by checkpoints.

It knows no operation: a step turns the carried values of a group of lanes (float64 `f`, integers
`k`) into the next ones. What the pointers of `table` are is listed in `engine.py`.

Backwards, each block of steps between two checkpoints is run again into a ring that stays in
cache, and the step's vector-Jacobian product walks it back. Blocks longer than FINE are first run
with checkpoints of their own.
"""

#: Steps of a ring.
FINE = 32

COMMON = r"""
const long long B = (long long)table[0], G = (long long)table[1], T = (long long)table[2];
const long long NOISE_INSTANTS = (long long)table[3], STRIDE = (long long)table[4];
const double LIMIT = *(const double*)table[5];
const double* const clocks = (const double*)table[6];
const V* const constant = (const V*)table[7] + (long long)g * N_CONSTANT;
const V* const segments = (const V*)table[8];
const int* const segment_of = (const int*)table[9];
const double* const noise_table = (const double*)table[10];
const int* const noise_row = (const int*)table[11];
const int* const noise_instant = (const int*)table[12];
V* const f_start = (V*)table[13] + (long long)g * N_F;
M* const k_start = (M*)table[14] + (long long)g * N_K;
double* const motion = (double*)table[15];
const int* const motion_slot = (const int*)table[16];
double* const state_f = (double*)table[17];
long long* const state_k = (long long*)table[18];
const int* const state_slot = (const int*)table[19];
int* const stop = (int*)table[20] + (long long)g * LANES;
int* const cause = (int*)table[21] + (long long)g * LANES;
V* const kept_f = (V*)table[22];
M* const kept_k = (M*)table[23];
const M* const whole = (const M*)table[25] + (long long)g * N_WHOLE;
V* heap = (V*)table[24] + (long long)table[26] * g;
V* const f_other = heap; heap += N_F;
M* const k_other = (M*)heap; heap += N_K;
V* const noise = heap; heap += N_NOISE;
$COMMON"""

_TOOLS = r"""
struct Tools : Lanes {
  // Unit normal numbers of this step: each lane reads the row of its seed.
  static inline CUDA_CALLABLE void draw(V* noise, const double* rows, const int* row,
                                        long long instants, int instant) {
    for (int w = 0; w < N_NOISE; ++w)
      for (int l = 0; l < LANES; ++l)
        put(&noise[w], l, rows[((long long)row[l] * instants + instant) * N_NOISE + w]);
  }
  static inline CUDA_CALLABLE void hold(M alive, V* f, M* k, const V* f_old, const M* k_old) {
    for (int e = 0; e < N_F; ++e) f[e] = sel(alive, f[e], f_old[e]);
    for (int e = 0; e < N_K; ++e) k[e] = isel(alive, k[e], k_old[e]);
  }
};
"""

FORWARD = r"""
struct Watch : Tools {
  static inline CUDA_CALLABLE M beyond(const V* f, double limit) {
    M bad = isplat(0);
    $BEYOND
    return bad;
  }
  // Number of the first leaf out of range, times 10, plus 1 for too large and 2 for not finite.
  static inline CUDA_CALLABLE int why(const V* f, int l, double limit) {
    $WHY
    return 0;
  }
  static inline CUDA_CALLABLE int leaf(const V* f, int l, double limit, int first, int last) {
    int found = 0;
    for (int e = first; e < last; ++e) {
      double x = get(f[e], l);
      if (!(x - x == 0.0)) found = 2;
      else if (!(x < limit && x > -limit) && found == 0) found = 1;
    }
    return found;
  }
};
V* f = f_start; M* k = k_start;
V* f_next = f_other; M* k_next = k_other;
M alive = Watch::isplat(0);
for (int l = 0; l < LANES; ++l) Watch::iput(&alive, l, stop[l] >= T ? -1 : 0);
for (long long s = first; s <= last; ++s) {
  if (s > first || s == 0) {
    const int row = motion_slot[s];
    if (row >= 0)
      for (int l = 0; l < LANES && (long long)g * LANES + l < B; ++l) {
        double* out = motion + ((long long)row * B + (long long)g * LANES + l) * N_MOTION;
        for (int e = 0; e < N_MOTION; ++e) out[e] = Watch::get(f[e], l);
      }
    const int kept_row = state_slot[s];
    if (kept_row >= 0)
      for (int l = 0; l < LANES && (long long)g * LANES + l < B; ++l) {
        const long long at = (long long)kept_row * B + (long long)g * LANES + l;
        for (int e = 0; e < N_F; ++e) state_f[at * N_F + e] = Watch::get(f[e], l);
        for (int e = 0; e < N_K; ++e) state_k[at * N_K + e] = Watch::iget(k[e], l);
      }
  }
  if (s == last) break;
  if (kept_f && s % STRIDE == 0) {
    V* to_f = kept_f + ((s / STRIDE) * G + g) * N_F;
    M* to_k = kept_k + ((s / STRIDE) * G + g) * N_K;
    for (int e = 0; e < N_F; ++e) to_f[e] = f[e];
    for (int e = 0; e < N_K; ++e) to_k[e] = k[e];
  }
  if (!Watch::any(alive)) continue;
  if (N_NOISE) Watch::draw(noise, noise_table, noise_row + (long long)g * LANES, NOISE_INSTANTS,
                           noise_instant[s]);
  Step::run(clocks + s * N_CLOCK, constant,
            segments + ((long long)segment_of[s] * G + g) * N_SEGMENT, noise, whole, f, k, $Wf_next,
            k_next, heap);
  const M fell = Watch::beyond(f_next, LIMIT) & alive;
  if (Watch::any(fell))
    for (int l = 0; l < LANES; ++l)
      if (Watch::iget(fell, l)) {
        stop[l] = (int)s;
        cause[l] = Watch::why(f_next, l, LIMIT);
        Watch::iput(&alive, l, 0);
      }
  if (!Watch::all(alive)) Watch::hold(alive, f_next, k_next, f, k);
  V* const f_swap = f; f = f_next; f_next = f_swap;
  M* const k_swap = k; k = k_next; k_next = k_swap;
}
if (f != f_start) {
  for (int e = 0; e < N_F; ++e) f_start[e] = f[e];
  for (int e = 0; e < N_K; ++e) k_start[e] = k[e];
}
"""

BACKWARD = r"""
V* const adj = (V*)table[27] + (long long)g * N_F;
V* const g_constant = (V*)table[28] + (long long)g * N_WANTED;
V* const g_segments = (V*)table[29];
const double* const g_motion = (const double*)table[30];
const double* const g_state = (const double*)table[31];
V* const adj_next = heap; heap += N_F;
V* const part_constant = heap; heap += N_WANTED;
V* const part_segment = heap; heap += N_WANTED_SEGMENT;
$ROOMV* const ring_f = heap; heap += (FINE + 1) * N_F;
M* const ring_k = (M*)heap; heap += (FINE + 1) * N_K;
V* const fine_f = heap; heap += (STRIDE / FINE) * N_F;
M* const fine_k = (M*)heap; heap += (STRIDE / FINE) * N_K;
M stops = Tools::isplat(0);
for (int l = 0; l < LANES; ++l) Tools::iput(&stops, l, stop[l]);
// first and last are numbers of blocks here.
for (long long block = last - 1; block >= first; --block) {
  const long long from = block * STRIDE, to = from + STRIDE < T ? from + STRIDE : T;
  const long long pieces = (to - from + FINE - 1) / FINE;
  const V* const begin_f = kept_f + (block * G + g) * N_F;
  const M* const begin_k = kept_k + (block * G + g) * N_K;
  for (long long pass = pieces > 1 ? -1 : 0; pass < pieces; ++pass) {
    // Pass -1 makes the fine checkpoints, later ones walk the pieces back, last one first.
    const long long piece = pass < 0 ? 0 : pieces - 1 - pass;
    const long long begin = from + piece * FINE;
    const long long end = pass < 0 ? to - FINE : begin + FINE < to ? begin + FINE : to;
    const V* source_f = pass < 0 || pieces == 1 ? begin_f : fine_f + piece * N_F;
    const M* source_k = pass < 0 || pieces == 1 ? begin_k : fine_k + piece * N_K;
    for (int e = 0; e < N_F; ++e) ring_f[e] = source_f[e];
    for (int e = 0; e < N_K; ++e) ring_k[e] = source_k[e];
    for (long long s = begin; s < (pass < 0 ? begin + (pieces - 1) * FINE : $LAST); ++s) {
      const long long here = (s - begin) % FINE, there = pass < 0 ? (here + 1) % FINE : here + 1;
      if (pass < 0 && here == 0) {
        V* const to_f = fine_f + ((s - from) / FINE) * N_F;
        M* const to_k = fine_k + ((s - from) / FINE) * N_K;
        for (int e = 0; e < N_F; ++e) to_f[e] = ring_f[e];
        for (int e = 0; e < N_K; ++e) to_k[e] = ring_k[e];
      }
      V* const f = ring_f + here * N_F; M* const k = ring_k + here * N_K;
      V* const f_next = ring_f + there * N_F; M* const k_next = ring_k + there * N_K;
      if (N_NOISE) Tools::draw(noise, noise_table, noise_row + (long long)g * LANES,
                               NOISE_INSTANTS, noise_instant[s]);
      Step::run(clocks + s * N_CLOCK, constant,
                segments + ((long long)segment_of[s] * G + g) * N_SEGMENT, noise, whole, f, k,
                $Wf_next, k_next, heap);
      const M alive = Tools::igt(stops, Tools::isplat(s));
      if (!Tools::all(alive)) Tools::hold(alive, f_next, k_next, f, k);
    }
    if (pass < 0) {
      const long long at = pieces - 1;
      for (int e = 0; e < N_F; ++e) fine_f[at * N_F + e] = ring_f[e];
      for (int e = 0; e < N_K; ++e) fine_k[at * N_K + e] = ring_k[e];
      continue;
    }
    for (long long s = end - 1; s >= begin; --s) {
      Gather::add(adj, g_motion, motion_slot[s + 1], g_state, state_slot[s + 1], B, g);
      const M alive = Tools::igt(stops, Tools::isplat(s));
      if (!Tools::any(alive)) continue;
      if (N_NOISE) Tools::draw(noise, noise_table, noise_row + (long long)g * LANES,
                               NOISE_INSTANTS, noise_instant[s]);
      const long long here = s - begin;
$IN      V* const g_segment = g_segments + ((long long)segment_of[s] * G + g) * N_WANTED_SEGMENT;
      Back::run(clocks + s * N_CLOCK, constant,
                segments + ((long long)segment_of[s] * G + g) * N_SEGMENT, noise, whole,
                ring_f + here * N_F, ring_k + here * N_K, $W$AFTERadj, adj_next, part_constant,
                part_segment, $SUMheap);
$OUT      if (Tools::all(alive)) {
        for (int e = 0; e < N_F; ++e) adj[e] = adj_next[e];
        for (int e = 0; e < N_WANTED; ++e) g_constant[e] += part_constant[e];
        for (int e = 0; e < N_WANTED_SEGMENT; ++e) g_segment[e] += part_segment[e];
      } else {
        const V zero = Tools::splat(0.0);
        for (int e = 0; e < N_F; ++e) adj[e] = Tools::sel(alive, adj_next[e], adj[e]);
        for (int e = 0; e < N_WANTED; ++e)
          g_constant[e] += Tools::sel(alive, part_constant[e], zero);
        for (int e = 0; e < N_WANTED_SEGMENT; ++e)
          g_segment[e] += Tools::sel(alive, part_segment[e], zero);
      }
    }
  }
  if (block == 0) Gather::add(adj, g_motion, motion_slot[0], g_state, state_slot[0], B, g);
}
$DONE"""

#: What a step left, where its gradient asks for that too.
AFTER = "ring_f + (here + 1) * N_F, ring_k + (here + 1) * N_K, "

GATHER = r"""
struct Gather : Lanes {
  // What the outputs of a step's end ask for.
  static inline CUDA_CALLABLE void add(V* adj, const double* g_motion, int row,
                                       const double* g_state, int whole, long long B, int g) {
    if (g_motion && row >= 0)
      for (int l = 0; l < LANES && (long long)g * LANES + l < B; ++l) {
        const double* from = g_motion + ((long long)row * B + (long long)g * LANES + l) * N_MOTION;
        for (int e = 0; e < N_MOTION; ++e) put(&adj[e], l, get(adj[e], l) + from[e]);
      }
    if (g_state && whole >= 0)
      for (int l = 0; l < LANES && (long long)g * LANES + l < B; ++l) {
        const double* from = g_state + ((long long)whole * B + (long long)g * LANES + l) * N_F;
        for (int e = 0; e < N_F; ++e) put(&adj[e], l, get(adj[e], l) + from[e]);
      }
  }
};
"""

TOOLS = _TOOLS
