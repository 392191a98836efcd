"""Whether the physics of a running axis changes: its torque residual against what a learning period has shown.

`residual` makes blocks of the residual of ticks, `baseline` learns from blocks, `evidence` tests blocks against what was
learned, `finding` says in words what has changed, `watch` is all of them for an axis that runs, `kept` makes of what was learned
the content of a file.
"""
