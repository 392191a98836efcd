"""Nodes that listen: identification, diagnosis, monitoring."""
