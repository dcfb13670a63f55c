"""The library's version: here alone; the wheel, the citation and the site read it."""

__version__ = "0.2.0"
