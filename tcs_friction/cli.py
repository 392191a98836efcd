"""The command line: finds the command, runs it, and turns errors into one line on stderr and an exit status."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

from tcs_friction.commands.parser import parser_of
from tcs_friction.errors import InputError, TcsError, nearest

COMMANDS = {
    "demo": "measure, identify, compensate, measure again: the paper's loop on the node graph",
    "node": "run one node",
    "graph": "run the whole graph",
    "simulate": "simulate an axis and its controller; writes a bag",
    "identify": "identify inertia and friction from bags",
    "diagnose": "find the physics that a model lacks against bags",
    "calibrate": "calibrate the friction observer against a dynamometer in bags",
    "response": "frequency response from torque to speed from bags, and models of it",
    "paper": "every table and figure of the paper, ours beside theirs",
    "bag": "look into bags, export and import them",
    "bench": "run a benchmark",
}


def one_thread_each() -> None:
    """Linear algebra in one thread: searches run in threads of their own, and matrices here are slim. Before numpy loads."""
    for library in ("OPENBLAS", "MKL", "BLIS"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def usage() -> str:
    """The page that `--help` and no command at all show."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:{width}}  {text}" for name, text in COMMANDS.items()]
    return (
        "usage: tcs-friction COMMAND ...\n\n"
        + "\n".join(lines)
        + "\n\nEach command explains itself: tcs-friction COMMAND --help"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit status: 0 done, 1 could not do it, 2 wrong usage or bad input."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    one_thread_each()
    try:
        try:
            return _command(words)
        finally:
            sys.stdout.flush()  # here, where a reader that has gone is no error
    except TcsError as error:
        print(f"tcs-friction: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        print("tcs-friction: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _command(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if words else 2
    name = words[0]
    if name not in COMMANDS:
        raise InputError("command line", f"no command {name!r}", nearest(name, COMMANDS))
    return _run(name, words[1:])


def _run(name: str, words: list[str]) -> int:
    module = importlib.import_module(f"tcs_friction.commands.{name}")
    parser = parser_of(name, module)
    if "--ros-args" in words and getattr(module, "TAKES_ROS_ARGUMENTS", False):
        cut = words.index("--ros-args")
        arguments = parser.parse_args(words[:cut])
        arguments.ros_arguments = words[cut:]
    else:
        arguments = parser.parse_args(words)
        arguments.ros_arguments = []
    return int(module.run(arguments) or 0)


if __name__ == "__main__":
    sys.exit(main())
