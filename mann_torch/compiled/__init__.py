"""Any traced step, compiled: forwards and backwards, in lanes and on all cores.

A row of passes, a room each: `trace` (torch function -> fx graph) -> `lowering` (-> nodes, which
`graph` simplifies) -> `cpp` (-> C++ text, in the arithmetic of `lanes`) -> `march` (the time loop
around it, checkpoints, autograd) -> `host` (Warp: text -> kernel, and its cache). Nothing here
knows an arm, an attention or a controller: a step is a function of lists of tensors (`Layout`).
Warp is imported when a kernel is first made.
"""

from .events.program import EVENT_LEAVES, EventProgram, HybridStep, Places
from .host.kernels import missing
from .march.agreement import check_agreement
from .march.autograd import Marched, march
from .march.job import Job
from .march.layout import Arguments, Layout, Leaf
from .march.program import Program
from .march.rows import Row, Rows, job_of, program_of
from .march.single import Single
from .trace.fingerprint import Fingerprint
from .trace.frozen import frozen
from .trace.telling import UntraceableError
from .trace.tracing import transformed, with_tensors

__all__ = [
    "EVENT_LEAVES",
    "Arguments",
    "EventProgram",
    "Fingerprint",
    "HybridStep",
    "Job",
    "Layout",
    "Leaf",
    "Marched",
    "Places",
    "Program",
    "Row",
    "Rows",
    "Single",
    "UntraceableError",
    "check_agreement",
    "frozen",
    "job_of",
    "march",
    "missing",
    "program_of",
    "transformed",
    "with_tensors",
]
