"""C++ text of a hybrid step: `simulation/events/steps.hybrid_step` on groups of lanes.

Where one lane meets an event all go through what it asks for, and drop what does not concern them.
"""

STEP = r"""
struct Step : Rules {
  static CUDA_CALLABLE void run(
      const double* clock, const V* constant, const V* segment, const V* noise, const M* whole,
      const V* f, const M* k, V* f_out, M* k_out, V* heap) {
    V* const f_0 = heap; heap += N_F;     // after the jump
    V* const f_1 = heap; heap += N_F;     // at the end
    V* const f_2 = heap; heap += N_F;     // tried
    V* const f_3 = heap; heap += N_F;
    M* const k_0 = (M*)heap; heap += N_K;
    M* const k_2 = (M*)heap; heap += N_K;
    M* const k_3 = (M*)heap; heap += N_K;
    V* const before = heap; heap += N_EVENTS;
    V* const after = heap; heap += N_EVENTS;
    V* const there = heap; heap += N_EVENTS;
    V* const own = heap; heap += N_SLOTS;
    V* const other = heap; heap += N_SLOTS;
    M* const crossed = (M*)heap; heap += N_EVENTS;
    const Scene scene = {clock, constant, segment, noise, whole, heap};
    const V t = splat(clock[0]), h = splat(clock[1]), zero = splat(0.0);
    const M none = isplat(0);
    for (int e = 0; e < N_F; ++e) f_0[e] = f[e];
    for (int e = 0; e < N_K; ++e) k_0[e] = k[e];
    // The jump.
    near(scene, t, f_0, k_0, before);
    const M due = ge(before[N_SLOTS], tie());
    if (any(due)) {
      reset(scene, t, f, k, f_2, k_2);
      take(due, f_0, f_2, N_F);
      itake(due, k_0, k_2);
      near(scene, t, f_0, k_0, before);
    }
    const M s = attend(before, k_0[K_ATTENDED]);
    const M changed = ine(s, k_0[K_ATTENDED]);
    attending(k_0, s);
    if (any(changed)) near(scene, t, f_0, k_0, before);  // it may read what is attended
    // The step, if nothing happens.
    branch(own, s);
    held(scene, t, h, own, f_0, k_0, f_1);
    events(before, s);
    near(scene, t + h, f_1, k_0, after);
    events(after, s);
    M open = none, pending = none;
    for (int j = 0; j < N_EVENTS; ++j) {
      crossed[j] = le(before[j], tie()) & gt(after[j], zero) & lt(after[j], inf_());
      open = open | crossed[j];
      pending = pending | gt(after[j], tie());
    }
    M slid = none, located = none, partner = s, event = s, next = s;
    V root = zero, value = zero, slope = splat(1.0);
    for (int e = 0; e < N_K; ++e) k_out[e] = k_0[e];
    if (any(open)) {
      const M single = open & ~crossed[N_SLOTS];
      if (any(single)) {
        partner = isel(single, which(after, crossed), s);
        branch(other, partner);
        held(scene, t, h, other, f_0, k_0, f_2);
        near(scene, t + h, f_2, k_0, there);
        const V back = at(there, s) - at(there, partner);
        slid = single & lt(back, at(before, partner));
        if (any(slid)) {
          const V forth = at(after, partner);
          const V share = sel(slid, -back, splat(0.5)) / sel(slid, forth - back, splat(1.0));
          for (int j = 0; j < N_SLOTS; ++j)
            other[j] = share * own[j] + (splat(1.0) - share) * other[j];
          held(scene, t, h, other, f_0, k_0, f_2);
          take(slid, f_1, f_2, N_F);
        }
      }
      open = open & ~slid;
      if (any(open)) {
        for (int j = 0; j < N_EVENTS; ++j) crossed[j] = crossed[j] & ~slid;
        root = first(scene, t, h, own, f_0, k_0, s, f_2, before, after, there, crossed, open);
        event = which(there, crossed);
        value = at(there, event);
        slope = slope_at(scene, t, h, root, own, f_0, k_0, s, f_2, there, event);
        const V rise = largest(after, crossed) - largest(before, crossed);
        located = open & gt(slope * h, graze() * rise + flat());
        event = isel(located, event, s);
      }
      if (any(located)) {
        root = sel(located, root, splat(0.5) * h);
        slope = sel(located, slope, splat(1.0));
        const V tau = root - sel(located, value, zero) / slope;
        held(scene, t, tau, own, f_0, k_0, f_2);
        for (int e = 0; e < N_K; ++e) k_2[e] = k_0[e];
        const M resets = located & ieq(event, isplat(N_SLOTS));
        attending(k_2, isel(resets, s, event));
        if (any(resets)) {
          reset(scene, t + tau, f_2, k_2, f_3, k_3);
          take(resets, f_2, f_3, N_F);
          itake(resets, k_2, k_3);
          near(scene, t + tau, f_2, k_2, there);
          attending(k_2, isel(resets, attend(there, k_2[K_ATTENDED]), k_2[K_ATTENDED]));
        }
        next = k_2[K_ATTENDED];
        branch(other, next);
        held(scene, t + tau, h - tau, other, f_2, k_2, f_3);
        take(located, f_1, f_3, N_F);
        itake(located, k_out, k_2);
      }
      // What is past its event at the end. While two slots chatter, a switch between them is not.
      near(scene, t + h, f_1, k_out, there);
      events(there, k_out[K_ATTENDED]);
      pending = none;
      for (int j = 0; j < N_EVENTS; ++j)
        pending = pending | (gt(there[j], tie()) & ~(slid & ieq(partner, isplat(j))));
    }
    k_out[K_N_LOCATED] += located & isplat(1);
    k_out[K_N_SLIDING] += slid & isplat(1);
    k_out[K_N_UNRESOLVED] += pending & isplat(1);
    k_out[K_KIND] = (slid & isplat(SLID)) | (located & isplat(LOCATED));
    k_out[K_DUE] = due;
    k_out[K_ATTENDED_THEN] = s;
    k_out[K_NUMBER] = isel(located, event, partner);
    k_out[K_NEXT] = next;
    k_out[K_ROOT] = bits(root);
    k_out[K_SLOPE] = bits(slope);
    Totals::run(f_1, clock, constant, segment, noise, whole, f_0, k_0, f_out, (M*)0, heap);
  }

  // `roots.first_root`: Illinois' rule on the largest of the events that are crossed. What they
  // come to at the root is left in `there`.
  static CUDA_CALLABLE V first(
      const Scene& scene, V t, V h, const V* own, const V* f_0, const M* k_0, M s, V* f_2,
      const V* before, const V* after, V* there, const M* crossed, M open) {
    V low = splat(0.0), high = h;
    V f_low = largest(before, crossed), f_high = largest(after, crossed);
    const V limit = max_(width() * (f_high - f_low), rounding());
    const M at_start = ge(f_low, splat(0.0));
    V root = sel(at_start, low, high), side = splat(0.0);
    M done = at_start | ~open;
    for (int turn = 0; turn < ITERATIONS; ++turn) {
      if (all(done)) break;
      const V x = sel(done, root, high - f_high * (high - low) / (f_high - f_low));
      probe(scene, t, x, own, f_0, k_0, s, f_2, there);
      const V found = largest(there, crossed);
      const M above = gt(found, splat(0.0));
      const V lower = sel(gt(side, splat(0.0)), splat(0.5) * f_low, f_low);
      const V higher = sel(lt(side, splat(0.0)), splat(0.5) * f_high, f_high);
      f_low = sel(above, lower, found);
      f_high = sel(above, found, higher);
      low = sel(above, low, x);
      high = sel(above, x, high);
      side = sel(above, splat(1.0), splat(-1.0));
      root = x;
      done = done | le(abs_(found), limit) | le(high - low, width() * h);
    }
    probe(scene, t, root, own, f_0, k_0, s, f_2, there);
    return root;
  }

  // `roots.slope_at`: central differences of fourth order.
  static CUDA_CALLABLE V slope_at(
      const Scene& scene, V t, V h, V root, const V* own, const V* f_0, const M* k_0, M s, V* f_2,
      V* there, M number) {
    const V delta = stencil() * h;
    V values[5];
    for (int i = 0; i < 5; ++i) {
      if (i == 2) continue;
      probe(scene, t, root + splat((double)(i - 2)) * delta, own, f_0, k_0, s, f_2, there);
      values[i] = at(there, number);
    }
    const V near_ones = splat(8.0) * (values[3] - values[1]);
    return (near_ones - (values[4] - values[0])) / (splat(12.0) * delta);
  }

  static CUDA_CALLABLE void probe(
      const Scene& scene, V t, V tau, const V* own, const V* f_0, const M* k_0, M s, V* f_2,
      V* there) {
    held(scene, t, tau, own, f_0, k_0, f_2);
    near(scene, t + tau, f_2, k_0, there);
    events(there, s);
  }
};
"""


def room(n_f: int, n_k: int, n_slots: int) -> int:
    """Vectors of working memory."""
    return 4 * n_f + 3 * n_k + 4 * (n_slots + 1) + 2 * n_slots
