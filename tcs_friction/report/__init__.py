"""What people read: figures, pages, tables of results."""

from tcs_friction.compiled_cache import choose_pictures_cache

choose_pictures_cache()
