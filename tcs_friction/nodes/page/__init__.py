"""The page's ear and hands in the graph."""
