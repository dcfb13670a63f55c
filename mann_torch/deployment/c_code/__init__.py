"""A deployed controller as C99: a header, a source, a test, a Makefile and a README."""

from .folder import to_c

__all__ = ["to_c"]
