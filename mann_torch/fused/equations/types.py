"""Warp types of one form: vectors and matrices of its sizes, and structs of them."""

from types import SimpleNamespace

import warp as wp

from ..form import CONSTANTS, N_COEFFICIENTS, N_EVENT, Form

N_JOINTS = 2
N_INPUTS = 5 * N_JOINTS


def make_types(form: Form) -> SimpleNamespace:
    """Types for N neurons, S slots; a loop without a memory gets one slot of one number."""
    real = wp.float64
    N, S = form.n_hidden, max(form.n_slots, 1)
    M = N if form.n_slots else 1
    pair = wp.types.vector(N_JOINTS, real)
    square = wp.types.matrix((N_JOINTS, N_JOINTS), real)
    hidden_vector = wp.types.vector(N, real)
    slot_vector = wp.types.vector(S, real)
    outer_weights = wp.types.matrix((N, N_JOINTS), real)
    inner_weights = wp.types.matrix((N_INPUTS, N), real)
    contents = wp.types.matrix((S, M), real)
    key_matrix = wp.types.matrix((S, N_JOINTS), real)
    counters = wp.types.vector(6 if form.hybrid else 3, wp.int32)

    @wp.struct
    class State:
        q: pair
        qd: pair
        W: outer_weights
        b_w: pair
        V: inner_weights
        b_v: hidden_vector
        mu: contents
        keys: key_matrix
        seen: pair  # measured joint position; not integrated

    @wp.struct
    class Sample:
        q: pair
        qd: pair
        qdd: pair
        noise_q: pair  # what the sensors add to the plant's motion
        noise_qd: pair

    @wp.struct
    class Gaze:
        error: pair
        r: pair
        x: wp.types.vector(N_INPUTS, real)
        pre: hidden_vector

    @wp.struct
    class Block:
        stiffness: square
        damping: square
        drift: pair

    @wp.struct
    class Mode:
        active: slot_vector  # 1 in use, 0 not
        counts: counters  # attended slot, switches, reallocations; located, sliding, unresolved

    return SimpleNamespace(
        real=real,
        N=N,
        S=S,
        M=M,
        I=N_INPUTS,
        motion_row=wp.types.vector((5 if form.effort else 3) * N_JOINTS, real),
        noise_row=wp.types.vector(2 * N_JOINTS, real),
        effort=wp.types.vector(2 * N_JOINTS, real),
        counters=counters,
        event_row=wp.types.vector(N_EVENT, real),
        event_values=wp.types.vector(S + 1, real),
        pair=pair,
        square=square,
        inputs=wp.types.vector(N_INPUTS, real),
        hidden_vector=hidden_vector,
        slot_vector=slot_vector,
        content_row=wp.types.vector(M, real),
        outer_weights=outer_weights,
        inner_weights=inner_weights,
        contents=contents,
        key_matrix=key_matrix,
        constants=wp.types.vector(len(CONSTANTS), real),
        coefficients=wp.types.vector(N_COEFFICIENTS, real),
        State=State,
        Sample=Sample,
        Gaze=Gaze,
        Angles=wp.types.vector(4, real),
        Block=Block,
        Mode=Mode,
    )
