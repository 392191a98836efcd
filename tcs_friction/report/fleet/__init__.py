"""The pages about a fleet: one for all axes, one for each."""
