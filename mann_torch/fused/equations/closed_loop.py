"""Rates of the whole loop; mirrors `control/mann.py` and `simulation/closed_loop.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import TIE, Form
from .arm import make_arm
from .functional import make_functional
from .memory import make_memory
from .network import make_network


def make_closed_loop(form: Form, t: SimpleNamespace) -> SimpleNamespace:
    """Rates, the stiff block, and the jump of one form."""
    real, State, Gaze, Sample, Block = t.real, t.State, t.Gaze, t.Sample, t.Block
    pair, square, constants, coefficients = t.pair, t.square, t.constants, t.coefficients
    hidden_vector, slot_vector = t.hidden_vector, t.slot_vector
    contents, key_matrix = t.contents, t.key_matrix
    S = t.S
    MEMORY, STATE_KEYS = form.n_slots > 0, form.keys == "state"
    # In hybrid steps a reset is past only beyond rounding: see `simulation/roots.py`.
    SLACK = wp.constant(real(TIE if form.hybrid else 0.0))
    REALLOCATES, ALWAYS, SCALED = form.reallocates, form.always, form.scaled_reset
    fn = make_functional(t)
    network, arm = make_network(form, t), make_arm(form, t, fn)
    look, slope_of, input_slope = network.look, network.slope_of, network.input_slope
    outer_square, inner_square = fn.outer_square, fn.inner_square
    contents_square, Angles = fn.contents_square, t.Angles
    mass_matrix, load_slope = arm.mass_matrix, arm.load_slope
    acceleration, solve, root = arm.acceleration, fn.solve, fn.root
    if MEMORY:
        memory = make_memory(form, t)
        write, key_rate_of = memory.write, memory.key_rate_of
        relevance, shift, fresh = memory.relevance, memory.shift, memory.fresh

    @wp.func
    def gain_of(y: State, active: slot_vector, c: constants):
        """K_v + k_v (|W| + |V| + |mu| + Z_m)."""
        norms = root(outer_square(y.W)) + root(inner_square(y.V))
        if MEMORY:
            norms = norms + root(contents_square(y.mu, active))
        return c[0] + c[1] * (norms + c[2])

    @wp.func
    def torque_of(y: State, gaze: Gaze, hidden: hidden_vector, weights: slot_vector, gain: real):
        """tau = gain r + W'(sigma + h_o) + b_w."""
        basis = hidden
        if MEMORY:
            basis = hidden + weights * y.mu
        return gain * gaze.r + basis * y.W + y.b_w

    @wp.func
    def rates(
        y: State,
        gaze: Gaze,
        hidden: hidden_vector,
        a: Angles,
        weights: slot_vector,
        torque: pair,
        c: constants,
        k: coefficients,
    ):
        """dy/dt."""
        d = State()
        correction = y.W * gaze.r
        slope = slope_of(hidden)
        if MEMORY:
            d.mu = write(y, weights, hidden, correction, c[6])
            if STATE_KEYS:
                d.keys = key_rate_of(weights, y, c[8])
        decay = c[5] * root(wp.dot(gaze.error, gaze.error))
        regressor = hidden - wp.cw_mul(slope, gaze.pre)
        back = wp.cw_mul(slope, correction)
        d.q = y.qd
        d.qd = acceleration(a, y.qd, torque, k)
        d.W = wp.outer(c[3] * regressor, gaze.r) - (c[3] * decay) * y.W
        d.b_w = c[3] * (gaze.r - decay * y.b_w)
        d.V = wp.outer(c[4] * gaze.x, back) - (c[4] * decay) * y.V
        d.b_v = c[4] * (back - decay * y.b_v)
        return d

    @wp.func
    def stiff_block(
        y: State,
        s: Sample,
        hidden: hidden_vector,
        a: Angles,
        gain: real,
        error_gain: square,
        k: coefficients,
    ):
        """M^-1 times the torque's gains: what is solved implicitly."""
        slope = input_slope(slope_of(hidden), y)
        rate = square(gain + slope[0, 0], slope[0, 1], slope[1, 0], gain + slope[1, 1])
        position = rate * error_gain
        drift = position * s.qd + rate * s.qdd
        friction = load_slope(y.qd, k)
        M = mass_matrix(a, k)
        stiff_0 = solve(M, pair(position[0, 0], position[1, 0]))
        stiff_1 = solve(M, pair(position[0, 1], position[1, 1]))
        damp_0 = solve(M, pair(rate[0, 0] + friction[0], rate[1, 0]))
        damp_1 = solve(M, pair(rate[0, 1], rate[1, 1] + friction[1]))
        block = Block()
        block.stiffness = square(stiff_0[0], stiff_1[0], stiff_0[1], stiff_1[1])
        block.damping = square(damp_0[0], damp_1[0], damp_0[1], damp_1[1])
        block.drift = solve(M, drift)
        return block

    @wp.func
    def reset_mask(y: State, hidden: hidden_vector, active: slot_vector, c: constants):
        """1 on the slot that is reset now, 0 elsewhere: a decision, without gradient."""
        mask = slot_vector()
        if REALLOCATES:
            full = int(1)
            for i in range(S):
                if active[i] < real(0.5):
                    full = int(0)
            if ALWAYS or full == 0:
                slot = shift(relevance(y, hidden, c[6]), active, c[7] + SLACK)
                if slot >= 0:
                    mask[slot] = real(1.0)
        return mask

    @wp.func_grad(reset_mask)
    def adj_reset_mask(
        y: State,
        hidden: hidden_vector,
        active: slot_vector,
        c: constants,
        adj_ret: slot_vector,
    ):
        pass

    @wp.func
    def raised(active: slot_vector, mask: slot_vector):
        """Slots in use after the reset."""
        return wp.max(active, mask)

    @wp.func
    def reset(y: State, hidden: hidden_vector, mask: slot_vector, c_w: real):
        """Contents after the reset: c_w sigma (or sigma) in the marked slot."""
        new = hidden
        if SCALED:
            new = c_w * hidden
        mu = contents()
        for i in range(S):
            mu[i] = (real(1.0) - mask[i]) * y.mu[i] + mask[i] * new
        return mu

    @wp.func
    def reset_keys(y: State, mask: slot_vector):
        """Keys after the reset: a fresh one in the marked slot."""
        keys = key_matrix()
        for i in range(S):
            keys[i] = (real(1.0) - mask[i]) * y.keys[i] + mask[i] * fresh(y.seen)
        return keys

    found = SimpleNamespace(
        look=look,
        sigmoid=fn.sigmoid,
        angles=arm.angles,
        fn=fn,
        gain_of=gain_of,
        rates=rates,
        torque_of=torque_of,
        stiff_block=stiff_block,
        reset_mask=reset_mask,
        raised=raised,
        reset=reset,
        reset_keys=reset_keys,
        solve=solve,
    )
    if MEMORY:
        found.attend, found.largest, found.memory = memory.attend, memory.largest, memory
    return found
