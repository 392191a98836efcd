"""Friction of telescope axes: measured, identified, compensated, diagnosed."""

from tcs_friction.compiled_cache import choose_cache

choose_cache()
