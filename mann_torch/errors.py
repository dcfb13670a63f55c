"""Named errors: each says what is wrong, where, and what to do about it."""


class MannError(Exception):
    """Base class of every error this library raises on purpose."""


class ConfigError(MannError, ValueError):
    """A setting is missing, malformed or outside its domain."""


class KindError(ConfigError, TypeError):
    """An argument is of the wrong type; the message names it and says what is wanted."""


class DomainError(ConfigError):
    """A design constant or physical quantity lies outside its domain."""


class ShapeError(ConfigError):
    """A tensor's shape does not fit the place it is used in."""


class DtypeError(ConfigError):
    """A tensor is not float64. float32 time has steps of 3e-5 s at t = 329 s."""


class InterfaceError(ConfigError, TypeError):
    """A part of one's own does not keep its interface's contract; the message says what to mend."""


class RecordError(ConfigError):
    """A rollout did not keep what it is asked for; the message says what to ask of it."""


class WeightsFileError(ConfigError):
    """A file of initial weights is missing, unreadable or does not fit."""


class ReferenceFileError(ConfigError):
    """A file of samples of a reference is missing, unreadable or does not fit."""


class ExportError(ConfigError):
    """A controller cannot be written in the form that is asked for; the message says why."""


class SolverError(MannError, RuntimeError):
    """An integration could not be carried on; the message names time and cause."""


class KernelError(MannError, RuntimeError):
    """A compiled kernel could not be compiled or loaded on this machine."""
