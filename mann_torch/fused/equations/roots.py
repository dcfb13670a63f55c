"""First root of the largest event function in a step; mirrors `simulation/roots.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import ITERATIONS, ROUNDING, STENCIL, WIDTH


def make_roots(t: SimpleNamespace, near: SimpleNamespace) -> SimpleNamespace:
    """The search and the slope, both without gradient; `near` is what `make_proximity` gave."""
    real, State, event_values = t.real, t.State, t.event_values
    slot_vector, S, Scene = t.slot_vector, t.S, near.Scene
    hop, branch, within, events_at = near.hop, near.branch, near.within, near.events_at
    WIDTH_, STENCIL_ = wp.constant(real(WIDTH)), wp.constant(real(STENCIL))
    ROUNDING_, ITERATIONS_ = wp.constant(real(ROUNDING)), wp.constant(ITERATIONS)

    @wp.func
    def probe(y: State, active: slot_vector, attended: int, tau: real, scene: Scene):
        s = within(scene, tau)
        at = hop(y, active, branch(attended), scene.s_0, s, tau, scene)
        return events_at(at, s, active, attended, scene)

    @wp.func
    def which(values: event_values, crossed: event_values):
        """The largest of the events that are crossed."""
        best = int(-1)
        for i in range(S + 1):
            if crossed[i] > real(0.5) and (best < 0 or values[i] > values[best]):
                best = i
        return best

    @wp.func
    def top(values: event_values, crossed: event_values):
        return values[which(values, crossed)]

    @wp.func
    def first_root(
        y: State,
        active: slot_vector,
        attended: int,
        h: real,
        crossed: event_values,
        before: event_values,
        after: event_values,
        scene: Scene,
    ):
        """Illinois' rule on the largest of the crossed events."""
        low = real(0.0)
        high = h
        f_low = top(before, crossed)
        f_high = top(after, crossed)
        limit = wp.max(WIDTH_ * (f_high - f_low), ROUNDING_)
        side = int(0)
        done = int(0)
        root = h
        if f_low >= real(0.0):
            done = int(1)
            root = low
        turn = int(0)
        while turn < ITERATIONS_ and done == 0:
            root = high - f_high * (high - low) / (f_high - f_low)
            f = top(probe(y, active, attended, root, scene), crossed)
            if f > real(0.0):
                if side > 0:
                    f_low = real(0.5) * f_low
                f_high = f
                high = root
                side = 1
            else:
                if side < 0:
                    f_high = real(0.5) * f_high
                f_low = f
                low = root
                side = -1
            if wp.abs(f) <= limit or high - low <= WIDTH_ * h:
                done = 1
            turn = turn + 1
        return root

    @wp.func_grad(first_root)
    def adj_first_root(
        y: State,
        active: slot_vector,
        attended: int,
        h: real,
        crossed: event_values,
        before: event_values,
        after: event_values,
        scene: Scene,
        adj_ret: real,
    ):
        pass

    @wp.func
    def slope_at(
        y: State,
        active: slot_vector,
        attended: int,
        root: real,
        h: real,
        number: int,
        scene: Scene,
    ):
        """Central difference of fourth order."""
        delta = STENCIL_ * h
        total = real(0.0)
        k = int(-2)
        while k <= 2:
            if k != 0:
                found = probe(y, active, attended, root + real(k) * delta, scene)[number]
                factor = real(1.0)
                if k == 1 or k == -1:
                    factor = real(-8.0)
                if k > 0:
                    factor = -factor
                total = total + factor * found
            k = k + 1
        return total / (real(12.0) * delta)

    @wp.func_grad(slope_at)
    def adj_slope_at(
        y: State,
        active: slot_vector,
        attended: int,
        root: real,
        h: real,
        number: int,
        scene: Scene,
        adj_ret: real,
    ):
        pass

    return SimpleNamespace(first_root=first_root, slope_at=slope_at, top=top, which=which)
