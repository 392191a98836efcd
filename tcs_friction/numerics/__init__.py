"""Numerical methods that more than one room uses. They know nothing of axes, friction or recordings."""
