"""What stands in for the plant at a real motor: nodes that pass torque on to drives, and nothing beyond the limits."""
