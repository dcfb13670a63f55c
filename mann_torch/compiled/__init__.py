"""Any traced step, compiled: forwards and backwards, in lanes and on all cores.

A row of passes: `tracing` (torch function -> fx graph) -> `lowering` (-> nodes, `graph`, `views`,
`arithmetic`) -> `cpp` (-> C++ text: plan, writer, time loop) -> `host` (Warp: -> kernel, `cache`)
-> `engine` (lanes, cores, checkpoints) -> `autograd`. Nothing here knows an arm, an attention or a
controller: a step is a function of lists of tensors (`layout`). Warp is imported when a kernel is
first made.
"""

from .autograd import Marched, march
from .engine import Job
from .frozen import frozen
from .host import missing
from .layout import Layout, Leaf
from .program import Program
from .tracing import Untraceable, transformed, with_tensors

__all__ = [
    "Job",
    "Layout",
    "Leaf",
    "Marched",
    "Program",
    "Untraceable",
    "frozen",
    "march",
    "missing",
    "transformed",
    "with_tensors",
]
