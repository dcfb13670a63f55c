"""The closed loop fused into one kernel, forwards and backwards, with NVIDIA Warp.

Mirrors the torch engine: `equations` holds the same equations file for file, `form` says which
loops have a fused form. Nothing here is needed for the torch engine, nor is Warp imported before
a kernel is.
"""

from ..compiled import missing
from .autograd import Kept, march
from .form import Form, form_of, unfused_part
from .job import LEAVES, Grid, Inputs, Job

__all__ = [
    "LEAVES",
    "Form",
    "Grid",
    "Inputs",
    "Job",
    "Kept",
    "form_of",
    "march",
    "missing",
    "unfused_part",
]
