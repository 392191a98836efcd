"""The commands of `./tcs`, one file each.

A command's module has `add_arguments(parser)` and `run(arguments)`, which returns the exit status (None is 0) and raises
TcsError for everything a user can put right. Modules are imported only when their command is called.
"""
