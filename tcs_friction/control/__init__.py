"""Control as pure transitions: controller, disturbance observers, compensators, references, the closed loop.

Each part is a compiled kernel on flat arrays (state, parameters), which a compiled loop calls, under a thin
class with a frozen, validated configuration, which a node calls once a tick. Nothing here reads a clock or
a file handle.
"""
