"""Hydra entry points and reports. Only this package imports hydra and tensorboard."""
