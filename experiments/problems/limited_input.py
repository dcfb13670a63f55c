"""Problem 7: an unstable plant whose input is limited."""

from __future__ import annotations

import math

from .known import Case, Problem, closed, printed
from .measures import mark, output_reaches

PROBLEM = Problem(
    "Limited input",
    "Karason and Annaswamy 1994",
    {
        "augmented": Case(
            "augmented error",
            ("problem=limited_input",),
            0.02,
            (
                printed("x(10 s)", "-4.50622", *mark("x", 10.0)),
                printed("theta(10 s)", "-2.16608", *mark("W", 10.0)),
                printed("k(10 s)", "1.11085", *mark("W", 10.0, 1)),
            ),
            ("W",),
        ),
        "unprotected": Case(
            "unprotected",
            ("problem=limited_input_unprotected",),
            0.02,
            (
                printed("theta(5 s)", "-52.973", *mark("W", 5.0)),
                printed("theta(10 s)", "-62.471", *mark("W", 10.0)),
            ),
            ("W",),
        ),
        "outside": Case(
            "from -10.01",
            ("problem=limited_input_outside",),
            0.02,
            (
                printed("|x| = 100 at [s]", "9.105", output_reaches(100.0)),
                closed("the same, log 9000", math.log(9000.0), output_reaches(100.0)),
            ),
            ("W",),
        ),
    },
)
