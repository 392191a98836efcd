"""Recorder and player, and what they share with nodes that keep bags."""
