"""Tuned constants judged where they have not been."""
