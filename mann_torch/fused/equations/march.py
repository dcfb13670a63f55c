"""The kernel: one thread a trajectory, the time loop inside."""

from types import SimpleNamespace
from typing import Any

import warp as wp

from ..form import Form
from .guard import make_guard
from .hybrid import make_hybrid
from .implicit import make_step
from .sinusoid import make_reference
from .types import make_types


def make_march(form: Form, gamma: float, backward: bool) -> Any:
    """The kernel of one form; with `backward`, its adjoint is compiled too.

    Steps `first` to `last`: step k reads row (k - first) % ring of the tape and writes row
    (k - first + 1) % ring, never a variable that the next step changes, so that the adjoint is
    exact as long as the ring holds all rows. Times with a slot >= 0 go to the outputs, too. A
    sample whose new state is out of range is held from there on: `stop` and `cause` say when and
    why, and its steps from there on are not computed, forwards or backwards.
    """
    t: SimpleNamespace = make_types(form)
    real, pair, square, State, Mode = t.real, t.pair, t.square, t.State, t.Mode
    constants, coefficients, motion_row = t.constants, t.coefficients, t.motion_row
    noise_values, effort_sums = t.noise_row, t.effort
    NOISE, EFFORT = form.noise, form.effort
    outer_weights, inner_weights, hidden_vector = t.outer_weights, t.inner_weights, t.hidden_vector
    contents, key_matrix, slot_vector, counters = (
        t.contents,
        t.key_matrix,
        t.slot_vector,
        t.counters,
    )
    MEMORY, STATE_KEYS = form.n_slots > 0, form.keys == "state"
    stepping, sample = make_step(form, t, gamma), make_reference(t).sample
    step, trouble = stepping.step, make_guard(form, t, stepping.fn).trouble
    HYBRID, event_row = form.hybrid, t.event_row
    hybrid_step = Scene = None
    if HYBRID:  # Warp builds every function that the kernel's source can reach
        hybrid = make_hybrid(form, t, stepping)
        hybrid_step, Scene, step = hybrid.step, hybrid.Scene, None

    @wp.kernel(module="unique", enable_backward=backward)
    def march(
        first: int,
        last: int,
        ring: int,
        offset: int,
        limit: real,
        # the grid: (T+1,)
        times: wp.array(dtype=real),
        segment: wp.array(dtype=wp.int32),
        motion_slot: wp.array(dtype=wp.int32),
        state_slot: wp.array(dtype=wp.int32),
        share: wp.array(dtype=real),
        noise_index: wp.array(dtype=wp.int32),
        effort_after: real,
        # the task: (B,), coefficients (segments, B)
        horizon: wp.array(dtype=real),
        amplitude: wp.array(dtype=pair),
        frequency: wp.array(dtype=pair),
        reference_offset: wp.array(dtype=pair),
        error_gain: wp.array(dtype=square),
        constant: wp.array(dtype=constants),
        coefficient: wp.array2d(dtype=coefficients),
        noise_std: wp.array(dtype=pair),
        noise_row: wp.array(dtype=wp.int32),
        noise_unit: wp.array2d(dtype=noise_values),
        # the tape: (ring, B)
        q: wp.array2d(dtype=pair),
        qd: wp.array2d(dtype=pair),
        W: wp.array2d(dtype=outer_weights),
        b_w: wp.array2d(dtype=pair),
        V: wp.array2d(dtype=inner_weights),
        b_v: wp.array2d(dtype=hidden_vector),
        mu: wp.array2d(dtype=contents),
        keys: wp.array2d(dtype=key_matrix),
        squared: wp.array2d(dtype=pair),
        torque: wp.array2d(dtype=pair),
        effort: wp.array2d(dtype=effort_sums),
        active: wp.array2d(dtype=slot_vector),
        counts: wp.array2d(dtype=counters),
        event: wp.array2d(dtype=event_row),
        # outputs: (slots, B)
        motion: wp.array2d(dtype=motion_row),
        q_out: wp.array2d(dtype=pair),
        qd_out: wp.array2d(dtype=pair),
        W_out: wp.array2d(dtype=outer_weights),
        b_w_out: wp.array2d(dtype=pair),
        V_out: wp.array2d(dtype=inner_weights),
        b_v_out: wp.array2d(dtype=hidden_vector),
        mu_out: wp.array2d(dtype=contents),
        keys_out: wp.array2d(dtype=key_matrix),
        active_out: wp.array2d(dtype=slot_vector),
        counts_out: wp.array2d(dtype=counters),
        # how it ended: (B,)
        stop: wp.array(dtype=wp.int32),
        cause: wp.array(dtype=wp.int32),
    ):
        b = wp.tid() + offset
        for k in range(first, last):
            i = (k - first) % ring
            j = (k - first + 1) % ring
            y = State()
            y.q = q[i, b]
            y.qd = qd[i, b]
            y.W = W[i, b]
            y.b_w = b_w[i, b]
            y.V = V[i, b]
            y.b_v = b_v[i, b]
            mode = Mode()
            if MEMORY:
                y.mu = mu[i, b]
                mode.active = active[i, b]
                mode.counts = counts[i, b]
            if STATE_KEYS:
                y.keys = keys[i, b]
                y.seen = q[i, b]
            if NOISE:
                unit = noise_unit[noise_row[b], noise_index[k]]
                noise_q = noise_std[b][0] * pair(unit[0], unit[1])
                noise_qd = noise_std[b][1] * pair(unit[2], unit[3])
                if STATE_KEYS:
                    y.seen = q[i, b] + noise_q
            total = squared[i, b]
            new = y
            new_mode = mode
            new_torque = pair()
            s_1 = sample(times[k + 1], amplitude[b], frequency[b], reference_offset[b])
            if k < stop[b]:
                s_0 = sample(times[k], amplitude[b], frequency[b], reference_offset[b])
                h = times[k + 1] - times[k]
                if NOISE:
                    s_0.noise_q = noise_q
                    s_0.noise_qd = noise_qd
                    s_1.noise_q = noise_q
                    s_1.noise_qd = noise_qd
                gain, c, coef = error_gain[b], constant[b], coefficient[segment[k], b]
                if HYBRID:
                    scene = Scene()
                    scene.time = times[k]
                    scene.s_0 = s_0
                    scene.s_1 = s_1
                    scene.amplitude = amplitude[b]
                    scene.frequency = frequency[b]
                    scene.offset = reference_offset[b]
                    scene.error_gain = gain
                    scene.c = c
                    scene.k = coef
                    out = hybrid_step(y, mode, h, scene, event[j, b])
                else:
                    out = step(y, mode, s_0, s_1, h, gain, c, coef)
                found = trouble(out.y, limit)
                if found == 0:
                    new = out.y
                    new_mode = out.mode
                    new_torque = out.torque
                    if HYBRID:
                        event[j, b] = out.event
                else:
                    stop[b] = k
                    cause[b] = found
            q[j, b] = new.q
            qd[j, b] = new.qd
            W[j, b] = new.W
            b_w[j, b] = new.b_w
            V[j, b] = new.V
            b_v[j, b] = new.b_v
            if MEMORY:
                mu[j, b] = new.mu
                active[j, b] = new_mode.active
                counts[j, b] = new_mode.counts
            if STATE_KEYS:
                keys[j, b] = new.keys
            if EFFORT:
                torque[j, b] = new_torque
            # From here on what is needed comes from the tape, see `replay_step`.
            q_1 = q[j, b]
            qd_1 = qd[j, b]
            if k < stop[b] and times[k + 1] <= horizon[b] + real(1e-9):
                error = s_1.q - q_1
                total = total + share[k + 1] * wp.cw_mul(error, error)
            squared[j, b] = total
            paid = effort_sums()
            if EFFORT:
                paid = effort[i, b]
                torque_1 = torque[j, b]
                # As `simulation/effort.py`: counted while the step is within the horizon.
                if k < stop[b] and times[k + 1] <= horizon[b] + real(1e-9):
                    if k > 0:
                        change = torque_1 - torque[i, b]
                        weight = real(1.0) / (times[k] - times[k - 1])
                        paid = paid + effort_sums(
                            weight * change[0] * change[0],
                            weight * change[1] * change[1],
                            real(0.0),
                            real(0.0),
                        )
                    if times[k] > effort_after + real(1e-9):
                        paid = effort_sums(
                            paid[0],
                            paid[1],
                            wp.max(paid[2], wp.abs(torque_1[0])),
                            wp.max(paid[3], wp.abs(torque_1[1])),
                        )
                effort[j, b] = paid
            slot = motion_slot[k + 1]
            if slot >= 0:
                if EFFORT:
                    motion[slot, b] = motion_row(
                        q_1[0],
                        q_1[1],
                        qd_1[0],
                        qd_1[1],
                        total[0],
                        total[1],
                        paid[0],
                        paid[1],
                        paid[2],
                        paid[3],
                    )
                else:
                    motion[slot, b] = motion_row(
                        q_1[0], q_1[1], qd_1[0], qd_1[1], total[0], total[1]
                    )
            kept = state_slot[k + 1]
            if kept >= 0:
                q_out[kept, b] = new.q
                qd_out[kept, b] = new.qd
                W_out[kept, b] = new.W
                b_w_out[kept, b] = new.b_w
                V_out[kept, b] = new.V
                b_v_out[kept, b] = new.b_v
                if MEMORY:
                    mu_out[kept, b] = new.mu
                    active_out[kept, b] = new_mode.active
                    counts_out[kept, b] = new_mode.counts
                if STATE_KEYS:
                    keys_out[kept, b] = new.keys

    return march
