"""A traced step as C99: no allocation, no recursion, static sizes."""

from .file import c99_file, c99_literals
from .library import WHOLE
from .unit import CUnit, c99_function, constants_in

__all__ = ["WHOLE", "CUnit", "c99_file", "c99_function", "c99_literals", "constants_in"]
