"""One jump and one step of the W-method; mirrors `simulation/implicit.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import Form
from .closed_loop import make_closed_loop


def make_step(form: Form, t: SimpleNamespace, gamma: float) -> SimpleNamespace:
    """The step y(t) -> y(t + h) with the reference at both ends."""
    real, State, Sample, Block, Mode = t.real, t.State, t.Sample, t.Block, t.Mode
    pair, square, constants, coefficients = t.pair, t.square, t.constants, t.coefficients
    Gaze, hidden_vector = t.Gaze, t.hidden_vector
    slot_vector, counters, S = t.slot_vector, t.counters, t.S
    MEMORY, STATE_KEYS = form.n_slots > 0, form.keys == "state"
    REALLOCATES, FOLLOW = form.reallocates, form.follow_reference
    ATTENDS = MEMORY and not form.hybrid
    GAMMA = wp.constant(real(gamma))
    loop = make_closed_loop(form, t)
    look, gain_of, rates, torque_of = loop.look, loop.gain_of, loop.rates, loop.torque_of
    NOISE, EFFORT = form.noise, form.effort
    sigmoid, angles = loop.sigmoid, loop.angles
    stiff_block, solve = loop.stiff_block, loop.solve
    reset_mask, reset, reset_keys = loop.reset_mask, loop.reset, loop.reset_keys
    if MEMORY:
        attend, largest, raised = loop.attend, loop.largest, loop.raised

    @wp.struct
    class Outcome:
        y: State
        mode: Mode
        torque: pair

    @wp.func
    def damped(f_q: pair, f_v: pair, block: Block, gh: real, push: pair):
        """k_v of (I - g h A)^-1 (f_q, f_v + push)."""
        one = square(real(1.0), real(0.0), real(0.0), real(1.0))
        matrix = one + gh * (block.damping + gh * block.stiffness)
        return solve(matrix, f_v + push - gh * (block.stiffness * f_q))

    @wp.func
    def seen(y: State, s: Sample):
        q = y.q
        if NOISE:
            q = q + s.noise_q
        return q

    @wp.func
    def flow(
        y: State,
        gaze: Gaze,
        hidden: hidden_vector,
        active: slot_vector,
        weights: slot_vector,
        s_0: Sample,
        s_1: Sample,
        h: real,
        error_gain: square,
        c: constants,
        k: coefficients,
    ):
        """Both stages, from what is seen at y; in hybrid forms the weights are held."""
        gain = gain_of(y, active, c)
        a = angles(y.q)
        torque = torque_of(y, gaze, hidden, weights, gain)
        f = rates(y, gaze, hidden, a, weights, torque, c, k)
        block = stiff_block(y, s_0, hidden, a, gain, error_gain, k)
        gh = GAMMA * h
        push = pair()
        if FOLLOW:
            push = gh * block.drift
        k_v = damped(f.q, f.qd, block, gh, push)
        k_q = f.q + gh * k_v

        y_1 = State()
        y_1.q = y.q + h * k_q
        y_1.qd = y.qd + h * k_v
        y_1.W = y.W + h * f.W
        y_1.b_w = y.b_w + h * f.b_w
        y_1.V = y.V + h * f.V
        y_1.b_v = y.b_v + h * f.b_v
        y_1.mu = y.mu + h * f.mu
        y_1.keys = y.keys + h * f.keys
        if STATE_KEYS:
            y_1.seen = seen(y_1, s_1)
        gaze_1 = look(s_1, y_1, error_gain)
        hidden_1 = sigmoid(gaze_1.pre)
        weights_1 = weights
        if ATTENDS:
            weights_1 = attend(y_1, hidden_1, active, c)
        gain_1 = gain_of(y_1, active, c)
        torque_1 = torque_of(y_1, gaze_1, hidden_1, weights_1, gain_1)
        f_1 = rates(y_1, gaze_1, hidden_1, angles(y_1.q), weights_1, torque_1, c, k)
        g_q = f_1.q - real(2.0) * k_q
        k_v2 = damped(g_q, f_1.qd - real(2.0) * k_v, block, gh, -push)
        k_q2 = g_q + gh * k_v2

        y_2 = State()
        half = real(0.5) * h
        y_2.q = y.q + half * (real(3.0) * k_q + k_q2)
        y_2.qd = y.qd + half * (real(3.0) * k_v + k_v2)
        # Outside the stiff block k2 = F2 - 2 k1, so that 3/2 k1 + 1/2 k2 = 1/2 (F1 + F2).
        y_2.W = y.W + half * (f.W + f_1.W)
        y_2.b_w = y.b_w + half * (f.b_w + f_1.b_w)
        y_2.V = y.V + half * (f.V + f_1.V)
        y_2.b_v = y.b_v + half * (f.b_v + f_1.b_v)
        y_2.mu = y.mu + half * (f.mu + f_1.mu)
        y_2.keys = y.keys + half * (f.keys + f_1.keys)
        if STATE_KEYS:
            y_2.seen = seen(y_2, s_1)
        return y_2

    # The adjoint of the flow computes it again itself, see `replay_step`.
    @wp.func_replay(flow)
    def replay_flow(
        y: State,
        gaze: Gaze,
        hidden: hidden_vector,
        active: slot_vector,
        weights: slot_vector,
        s_0: Sample,
        s_1: Sample,
        h: real,
        error_gain: square,
        c: constants,
        k: coefficients,
    ):
        return State()

    @wp.func
    def count(mode: Mode, attended: int, mask: slot_vector):
        counts = mode.counts
        if counts[0] >= 0 and attended != counts[0]:
            counts[1] = counts[1] + 1
        for i in range(S):
            if mask[i] > real(0.5):
                counts[2] = counts[2] + 1
        counts[0] = attended
        return counts

    @wp.func_grad(count)
    def adj_count(mode: Mode, attended: int, mask: slot_vector, adj_ret: counters):
        pass

    @wp.func
    def step(
        before: State,
        mode: Mode,
        s_0: Sample,
        s_1: Sample,
        h: real,
        error_gain: square,
        c: constants,
        k: coefficients,
    ):
        out = Outcome()
        gaze = look(s_0, before, error_gain)
        hidden = sigmoid(gaze.pre)
        y = before
        active = mode.active
        weights = slot_vector()
        mask = slot_vector()
        if MEMORY:
            if REALLOCATES:
                mask = reset_mask(before, hidden, active, c)
                y.mu = reset(before, hidden, mask, c[6])
                if STATE_KEYS:
                    y.keys = reset_keys(before, mask)
                active = raised(active, mask)
            weights = attend(y, hidden, active, c)
            out.mode.active = active
            out.mode.counts = count(mode, largest(weights, active), mask)

        if EFFORT:
            out.torque = torque_of(y, gaze, hidden, weights, gain_of(y, active, c))
        out.y = flow(y, gaze, hidden, active, weights, s_0, s_1, h, error_gain, c, k)
        return out

    # The adjoint of a step computes the step again itself: what the kernel's own backward pass
    # would compute before that, and throw away, is left out.
    @wp.func_replay(step)
    def replay_step(
        before: State,
        mode: Mode,
        s_0: Sample,
        s_1: Sample,
        h: real,
        error_gain: square,
        c: constants,
        k: coefficients,
    ):
        return Outcome()

    return SimpleNamespace(step=step, flow=flow, count=count, loop=loop, fn=loop.fn)
