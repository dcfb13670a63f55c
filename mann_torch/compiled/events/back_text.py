"""C++ text of a hybrid step's vector-Jacobian product: the chain of its pieces' own.

What happened in the step is not decided again: it stands in the notes that the step left.
"""

BACK = r"""
struct Back : Rules {
  // What the pieces' gradients add up in, and where each writes its own.
  struct Sums {
    V* carry; V* constants; V* segments;
    V* part; V* part_constants; V* part_segments; V* moment; V* weights;
  };
  static inline CUDA_CALLABLE void add(const Sums& g, M mask) {
    const V zero = splat(0.0);
    for (int e = 0; e < N_F; ++e) g.carry[e] += sel(mask, g.part[e], zero);
    add_shared(g, mask);
  }
  static inline CUDA_CALLABLE void add_shared(const Sums& g, M mask) {
    const V zero = splat(0.0);
    for (int e = 0; e < N_WANTED; ++e) g.constants[e] += sel(mask, g.part_constants[e], zero);
    for (int e = 0; e < N_WANTED_SEGMENT; ++e)
      g.segments[e] += sel(mask, g.part_segments[e], zero);
  }
  static inline CUDA_CALLABLE void held_back(const Sums& g, const Scene& s, V t, V h,
                                             const V* weights, const V* f, const M* k,
                                             const V* adj) {
    const V moment[2] = {t, h};
    BackHeld::run(moment, weights, s.clock, s.constant, s.segment, s.noise, s.whole, f, k, adj,
                  g.part, g.part_constants, g.part_segments, g.moment, g.weights, s.heap);
  }
  static inline CUDA_CALLABLE void near_back(const Sums& g, const Scene& s, V t, const V* f,
                                             const M* k, const V* adj) {
    const V moment[1] = {t};
    BackNear::run(moment, s.clock, s.constant, s.segment, s.noise, s.whole, f, k, adj, g.part,
                  g.part_constants, g.part_segments, g.moment, s.heap);
  }
  static inline CUDA_CALLABLE void reset_back(const Sums& g, const Scene& s, V t, const V* f,
                                              const M* k, const V* adj) {
    const V moment[1] = {t};
    BackReset::run(moment, s.clock, s.constant, s.segment, s.noise, s.whole, f, k, adj, g.part,
                   g.part_constants, g.part_segments, g.moment, s.heap);
  }
  // The gradient of event function `number`, seen from slot s, from that of its value.
  static inline CUDA_CALLABLE void event_back(V* adj, M s, M number, V value) {
    const V zero = splat(0.0);
    const M reset = ieq(number, isplat(N_SLOTS));
    for (int j = 0; j < N_SLOTS; ++j)
      adj[j] = sel(ieq(s, isplat(j)) & ~reset, value, zero) -
               sel(ieq(number, isplat(j)), value, zero);
    adj[N_SLOTS] = sel(reset, value, zero);
  }

  static CUDA_CALLABLE void run(
      const double* clock, const V* constant, const V* segment, const V* noise, const M* whole,
      const V* f, const M* k, const V* f_after, const M* k_after, const V* adj, V* adj_out,
      V* g_constant, V* g_segment, V* heap) {
    V* const f_0 = heap; heap += N_F;
    V* const f_2 = heap; heap += N_F;
    V* const f_3 = heap; heap += N_F;
    V* const g_1 = heap; heap += N_F;     // to the state at the end
    V* const g_2 = heap; heap += N_F;
    M* const k_0 = (M*)heap; heap += N_K;
    M* const k_2 = (M*)heap; heap += N_K;
    M* const k_3 = (M*)heap; heap += N_K;
    V* const there = heap; heap += N_EVENTS;
    V* const g_near = heap; heap += N_EVENTS;
    V* const own = heap; heap += N_SLOTS;
    V* const other = heap; heap += N_SLOTS;
    V* const mixed = heap; heap += N_SLOTS;
    V* const g_time = heap; heap += N_WANTED + N_WANTED_SEGMENT;
    V moment[2];
    Sums g = {adj_out, g_constant, g_segment, heap, 0, 0, moment, 0};
    heap += N_F;
    g.part_constants = heap; heap += N_WANTED;
    g.part_segments = heap; heap += N_WANTED_SEGMENT;
    g.weights = heap; heap += N_SLOTS;
    const Scene scene = {clock, constant, segment, noise, whole, heap};
    const V t = splat(clock[0]), h = splat(clock[1]), zero = splat(0.0), one = splat(1.0);
    const M due = k_after[K_DUE], s = k_after[K_ATTENDED_THEN], number = k_after[K_NUMBER];
    const M slid = ieq(k_after[K_KIND], isplat(SLID));
    const M located = ieq(k_after[K_KIND], isplat(LOCATED));
    const V root = from_bits(k_after[K_ROOT]), slope = from_bits(k_after[K_SLOPE]);
    for (int e = 0; e < N_WANTED; ++e) g_constant[e] = zero;
    for (int e = 0; e < N_WANTED_SEGMENT; ++e) g_segment[e] = zero;
    for (int e = 0; e < N_F; ++e) f_0[e] = f[e];
    for (int e = 0; e < N_K; ++e) k_0[e] = k[e];
    if (any(due)) {
      reset(scene, t, f, k, f_2, k_2);
      take(due, f_0, f_2, N_F);
      itake(due, k_0, k_2);
    }
    attending(k_0, s);
    branch(own, s);
    BackTotals::run(f_after, clock, constant, segment, noise, whole, f_0, k_0, adj, adj_out,
                    g.part_constants, g.part_segments, g_1, heap);
    add_shared(g, isplat(-1));
    if (!all(located)) {
      V forth = one, back = zero;
      for (int j = 0; j < N_SLOTS; ++j) mixed[j] = own[j];
      if (any(slid)) {
        branch(other, number);
        held(scene, t, h, own, f_0, k_0, f_2);
        near(scene, t + h, f_2, k_0, there);
        forth = sel(slid, at(there, s) - at(there, number), one);
        held(scene, t, h, other, f_0, k_0, f_3);
        near(scene, t + h, f_3, k_0, there);
        back = sel(slid, at(there, s) - at(there, number), zero);
        const V share = -back / (forth - back);
        for (int j = 0; j < N_SLOTS; ++j)
          mixed[j] = sel(slid, share * own[j] + (one - share) * other[j], own[j]);
      }
      held_back(g, scene, t, h, mixed, f_0, k_0, g_1);
      add(g, ~located);
      if (any(slid)) {
        // share = -back / (forth - back).
        V g_share = zero;
        for (int j = 0; j < N_SLOTS; ++j) g_share += g.weights[j] * (own[j] - other[j]);
        const V scale = g_share / ((forth - back) * (forth - back));
        event_back(g_near, s, number, back * scale);
        near_back(g, scene, t + h, f_2, k_0, g_near);
        add_shared(g, slid);
        for (int e = 0; e < N_F; ++e) g_2[e] = g.part[e];
        held_back(g, scene, t, h, own, f_0, k_0, g_2);
        add(g, slid);
        event_back(g_near, s, number, -forth * scale);
        near_back(g, scene, t + h, f_3, k_0, g_near);
        add_shared(g, slid);
        for (int e = 0; e < N_F; ++e) g_2[e] = g.part[e];
        held_back(g, scene, t, h, other, f_0, k_0, g_2);
        add(g, slid);
      }
    }
    if (any(located)) {
      held(scene, t, root, own, f_0, k_0, f_2);
      near(scene, t + root, f_2, k_0, there);
      events(there, s);
      const V tau = root - at(there, number) / slope;
      // Back through the rest of the step,
      held(scene, t, tau, own, f_0, k_0, f_2);
      const M resets = located & ieq(number, isplat(N_SLOTS));
      for (int e = 0; e < N_K; ++e) k_2[e] = k_0[e];
      for (int e = 0; e < N_F; ++e) f_3[e] = f_2[e];
      if (any(resets)) {
        reset(scene, t + tau, f_2, k_0, g_2, k_3);
        take(resets, f_3, g_2, N_F);
        itake(resets, k_2, k_3);
      }
      k_2[K_ATTENDED] = k_after[K_NEXT];
      branch(other, k_2[K_ATTENDED]);
      held_back(g, scene, t + tau, h - tau, other, f_3, k_2, g_1);
      add_shared(g, located);
      V g_tau = moment[0] - moment[1];
      for (int e = 0; e < N_F; ++e) g_2[e] = g.part[e];
      // the event,
      if (any(resets)) {
        reset_back(g, scene, t + tau, f_2, k_0, g_2);
        add_shared(g, resets);
        take(resets, g_2, g.part, N_F);
        g_tau += sel(resets, moment[0], zero);
      }
      // the step up to it, and its time.
      held_back(g, scene, t, tau, own, f_0, k_0, g_2);
      add(g, located);
      g_tau += moment[1];
      held(scene, t, root, own, f_0, k_0, f_2);
      // Its slope, exactly, is the gradient of the event function to the time.
      event_back(g_near, s, number, one);
      near_back(g, scene, t + root, f_2, k_0, g_near);
      const V steep = moment[0];
      for (int e = 0; e < N_F; ++e) g_2[e] = g.part[e];
      for (int e = 0; e < N_WANTED; ++e) g_time[e] = g.part_constants[e];
      for (int e = 0; e < N_WANTED_SEGMENT; ++e) g_time[N_WANTED + e] = g.part_segments[e];
      held_back(g, scene, t, root, own, f_0, k_0, g_2);
      const V factor = -g_tau / (steep + moment[1]);
      for (int e = 0; e < N_F; ++e) g.part[e] = factor * g.part[e];
      for (int e = 0; e < N_WANTED; ++e)
        g.part_constants[e] = factor * (g.part_constants[e] + g_time[e]);
      for (int e = 0; e < N_WANTED_SEGMENT; ++e)
        g.part_segments[e] = factor * (g.part_segments[e] + g_time[N_WANTED + e]);
      add(g, located);
    }
    if (any(due)) {
      for (int e = 0; e < N_F; ++e) g_2[e] = adj_out[e];
      reset_back(g, scene, t, f, k, g_2);
      add_shared(g, due);
      take(due, adj_out, g.part, N_F);
    }
  }
};
"""


def room_backward(n_f: int, n_k: int, n_slots: int, wanted: int, wanted_segment: int) -> int:
    """Vectors of working memory."""
    return 6 * n_f + 3 * n_k + 2 * (n_slots + 1) + 4 * n_slots + 2 * (wanted + wanted_segment)
