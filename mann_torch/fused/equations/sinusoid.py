"""Sinusoidal reference; mirrors `signals/reference.py`."""

from types import SimpleNamespace

import warp as wp


def make_reference(t: SimpleNamespace) -> SimpleNamespace:
    """s, ds/dt, d2s/dt2 at one time."""
    real, pair, Sample = t.real, t.pair, t.Sample

    @wp.func
    def sample(time: real, amplitude: pair, frequency: pair, offset: pair):
        phase = frequency * time
        swing = wp.cw_mul(amplitude, pair(wp.sin(phase[0]), wp.sin(phase[1])))
        s = Sample()
        s.q = offset + swing
        s.qd = wp.cw_mul(wp.cw_mul(amplitude, frequency), pair(wp.cos(phase[0]), wp.cos(phase[1])))
        s.qdd = -wp.cw_mul(wp.cw_mul(frequency, frequency), swing)
        return s

    return SimpleNamespace(sample=sample)
