"""What happens in a hybrid step; mirrors the choices of `simulation/events.py`.

A step's event is a row: kind (0 none, 1 switch, 2 reset, 3 chattering), number of the event
function, branch attended after it (chattering: the other one), root [s], slope [1/s], and the slot
that is reset (kind 0: 1 where an event is left pending). The forward pass decides it and keeps it
on the tape; the backward pass reads it there and differentiates what it says.
"""

from types import SimpleNamespace

import warp as wp

from ..form import FLAT, GRAZE, TIE, Form
from .roots import make_roots


def make_decision(
    form: Form, t: SimpleNamespace, loop: SimpleNamespace, near: SimpleNamespace
) -> SimpleNamespace:
    """`decide`, without gradient; replayed, it returns what the tape knows."""
    real, State, event_row, S = t.real, t.State, t.event_row, t.S
    slot_vector, hidden_vector, event_values = t.slot_vector, t.hidden_vector, t.event_values
    STATE_KEYS, REALLOCATES = form.keys == "state", form.reallocates
    look, sigmoid, reset, reset_keys = loop.look, loop.sigmoid, loop.reset, loop.reset_keys
    shift, relevance = loop.memory.shift, loop.memory.relevance
    Scene, branch, hop, within = near.Scene, near.branch, near.hop, near.within
    compare, events_at, attend = near.compare, near.events_at, near.attend
    roots = make_roots(t, near)
    first_root, slope_at, top, which = roots.first_root, roots.slope_at, roots.top, roots.which
    TIE_, GRAZE_, FLAT_ = (wp.constant(real(x)) for x in (TIE, GRAZE, FLAT))
    INF = wp.constant(real(wp.inf))

    @wp.func
    def mark(e: event_row):
        """1 on the slot that the event resets."""
        mask = slot_vector()
        if int(e[0]) == 2:
            mask[int(e[5])] = real(1.0)
        return mask

    @wp.func_grad(mark)
    def adj_mark(e: event_row, adj_ret: slot_vector):
        pass

    @wp.func
    def is_pending(values: event_values, partner: int):
        found = int(0)
        for i in range(S + 1):
            if i != partner and values[i] > TIE_:
                found = int(1)
        return found

    @wp.func_grad(is_pending)
    def adj_is_pending(values: event_values, partner: int, adj_ret: wp.int32):
        pass

    @wp.func
    def decide(
        y: State,
        hidden: hidden_vector,
        end: State,
        active: slot_vector,
        attended: int,
        h: real,
        scene: Scene,
        known: event_row,
    ):
        e = event_row()
        after = events_at(end, scene.s_1, active, attended, scene)
        passed = int(0)
        for i in range(S + 1):
            if after[i] > real(0.0):
                passed = int(1)
        if passed == 0:
            return e
        before = compare(y, hidden, active, attended, scene.c)
        crossed = event_values()
        number = int(0)
        for i in range(S + 1):
            if before[i] <= TIE_ and after[i] > real(0.0) and after[i] < INF:
                crossed[i] = real(1.0)
                number = number + 1
        e[5] = real(is_pending(after, -1))
        if number == 0:
            return e
        if crossed[S] < real(0.5):
            partner = which(after, crossed)
            other = hop(y, active, branch(partner), scene.s_0, scene.s_1, h, scene)
            back = events_at(other, scene.s_1, active, attended, scene)
            if back[partner] < before[partner]:
                e[0] = real(3.0)
                e[1] = real(partner)
                e[2] = real(partner)
                return e
        root = first_root(y, active, attended, h, crossed, before, after, scene)
        s_r = within(scene, root)
        at = hop(y, active, branch(attended), scene.s_0, s_r, root, scene)
        event = which(events_at(at, s_r, active, attended, scene), crossed)
        slope = slope_at(y, active, attended, root, h, event, scene)
        if slope * h <= GRAZE_ * (top(after, crossed) - top(before, crossed)) + FLAT_:
            return e
        e[0] = real(1.0)
        e[1] = real(event)
        e[2] = real(event)
        e[3] = root
        e[4] = slope
        if REALLOCATES and event == S:
            seen = sigmoid(look(s_r, at, scene.error_gain).pre)
            slot = shift(relevance(at, seen, scene.c[6]), active, real(-1.0))
            e[0] = real(2.0)
            e[5] = real(slot)
            mask = mark(e)
            at.mu = reset(at, seen, mask, scene.c[6])
            if STATE_KEYS:
                at.keys = reset_keys(at, mask)
            e[2] = real(attend(at, seen, wp.max(active, mask), attended, scene.c))
        return e

    @wp.func_grad(decide)
    def adj_decide(
        y: State,
        hidden: hidden_vector,
        end: State,
        active: slot_vector,
        attended: int,
        h: real,
        scene: Scene,
        known: event_row,
        adj_ret: event_row,
    ):
        pass

    @wp.func_replay(decide)
    def replay_decide(
        y: State,
        hidden: hidden_vector,
        end: State,
        active: slot_vector,
        attended: int,
        h: real,
        scene: Scene,
        known: event_row,
    ):
        return known

    return SimpleNamespace(mark=mark, is_pending=is_pending, decide=decide)
