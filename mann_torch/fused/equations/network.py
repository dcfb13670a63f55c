"""Filtered error and adaptive network; mirrors `control/tracking.py` and `control/network.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import Form


def make_network(form: Form, t: SimpleNamespace) -> SimpleNamespace:
    """What the controller sees at one state, and what its weights do."""
    real, square, inputs = t.real, t.square, t.inputs
    hidden_vector, State, Sample, Gaze = t.hidden_vector, t.State, t.Sample, t.Gaze
    NOISE = form.noise

    @wp.func
    def look(s: Sample, y: State, error_gain: square):
        error = s.q - y.q
        error_rate = s.qd - y.qd
        if NOISE:
            error = error - s.noise_q
            error_rate = error_rate - s.noise_qd
        x = inputs(
            error[0],
            error[1],
            error_rate[0],
            error_rate[1],
            s.q[0],
            s.q[1],
            s.qd[0],
            s.qd[1],
            s.qdd[0],
            s.qdd[1],
        )
        gaze = Gaze()
        gaze.error = error
        gaze.r = error_rate + error_gain * error
        gaze.x = x
        gaze.pre = x * y.V + y.b_v
        return gaze

    @wp.func
    def slope_of(hidden: hidden_vector):
        return wp.cw_mul(hidden, hidden_vector(real(1.0)) - hidden)

    @wp.func
    def input_slope(slope: hidden_vector, y: State):
        """d(W' sigma)/d(de/dt): column i is W' (sigma' V_i), V_i the row of input n + i."""
        first = wp.cw_mul(y.V[2], slope) * y.W
        second = wp.cw_mul(y.V[3], slope) * y.W
        return square(first[0], second[0], first[1], second[1])

    return SimpleNamespace(look=look, slope_of=slope_of, input_slope=input_slope)
