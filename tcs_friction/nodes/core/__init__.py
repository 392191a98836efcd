"""What every node stands on: configuration as parameters, executor, health, messages as bytes, other nodes."""
