"""How every engine finds events inside a step; see `simulation/events`."""

#: An event function this far above 0 is past its event; rounding stays below. Its units: those of
#: sigma for contents and theta, [rad] for state keys.
TIE = 1e-10
#: A slope below this part of the mean slope over the step, or a rise below `FLAT`, is no crossing.
GRAZE = 1e-6
FLAT = 1e-13
#: Width of the difference stencil, and of the last bracket, as parts of the step.
STENCIL = 3e-4
WIDTH = 1e-13
#: Rounding of an event function.
ROUNDING = 2e-16
ITERATIONS = 60
