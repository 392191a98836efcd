"""Identification: friction laws, inertia and plant from recordings."""
