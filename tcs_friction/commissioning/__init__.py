"""Commissioning an axis: which runs follow one another, what is kept of them and what is decided. No ROS here.

The room says what is to be done; `stages.Nodes` is what it asks of whoever can have it done: the node `commission`.
"""
