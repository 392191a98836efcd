"""The page of a running graph: what a node heard, thinned without losing a peak, and the server that shows it."""
