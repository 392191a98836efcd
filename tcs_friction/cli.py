"""The command line: finds the command, runs it, and turns errors into one line on stderr and an exit status."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import itertools
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, TextIO, cast

from tcs_friction.commands.parser import parser_of
from tcs_friction.errors import InputError, JobError, TcsError, nearest, refusal
from tcs_friction.interrupts import interruptible
from tcs_friction.plain_files import plain_file

COMMANDS = {
    "new": "a first axis file from a recording alone",
    "demo": "measure, identify, compensate, measure again: the paper's loop on the node graph",
    "node": "run one node",
    "graph": "run the whole graph",
    "ros": "services, topics, parameters, life cycles and actions of the running graph, as `ros2` has them",
    "live": "show the running graph on a web page",
    "simulate": "simulate an axis and its controller; writes a bag",
    "identify": "identify inertia and friction from bags",
    "diagnose": "find the physics that a model lacks against bags",
    "compensate": "predict what cancelling the physics of an axis file gains on a run",
    "export": "an axis in your simulator's model, your drive's table or your firmware",
    "compare": "measured beside simulated: a simulation's bag, or the model driven by the recording",
    "calibrate": "calibrate the friction observer against a dynamometer in bags",
    "response": "frequency response from torque to speed from bags, and models of it",
    "paper": "every table and figure of the paper, ours beside theirs",
    "bag": "look into bags, export and import them",
    "fleet": "identify and diagnose many recordings of many axes on Dask; what changed over time",
    "bench": "run a benchmark",
}

ROS_FILES = ("--params-file", "--log-config-file")


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
        with interruptible(last=arguments is None), contextlib.redirect_stdout(cast(TextIO, _Output(sys.stdout))):
            try:
                return _command(words)
            finally:
                sys.stdout.flush()  # here, where a reader that has gone is no error
    except TcsError as error:
        return _fail(error)
    except KeyboardInterrupt:
        print("tcs-friction: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 0
    except OSError as error:  # what nobody nearer to it could say more about
        return _fail(refusal(error))
    except Exception as error:
        from tcs_friction.physics.registry import raised_by_plug_in

        plug_in = raised_by_plug_in(error)
        if plug_in is None:
            raise
        return _fail(JobError(plug_in, f"{type(error).__name__}: {error}", "what a term declares (tcs_friction.physics.terms)"))


def _fail(error: TcsError) -> int:
    print(f"tcs-friction: {error}", file=sys.stderr)
    return error.exit_status


class _Output:
    """Standard output, whose refusals are told from those of files: a reader that has gone, a file on a full disk."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """As of any stream; BrokenPipeError, or JobError, when the system refuses it."""
        with self._refused():
            return self._stream.write(text)

    def flush(self) -> None:
        """The same for what has been kept back."""
        with self._refused():
            self._stream.flush()

    @contextlib.contextmanager
    def _refused(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            # What is still buffered goes nowhere: the end of the process shall not try to write it once more.
            os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
            if isinstance(error, BrokenPipeError):
                raise
            raise JobError("standard output", f"cannot be written ({error.strerror})") from None


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
    if words and words[0] in getattr(module, "SUBCOMMANDS", {}):
        return _run_subcommand(name, module.SUBCOMMANDS[words[0]], words)
    return _run_module(name, module, words)


def _run_subcommand(name: str, file: str, words: list[str]) -> int:
    """A command of two words, in a file of its own."""
    path = f"tcs_friction.commands.{file}"
    if importlib.util.find_spec(path) is None:
        raise InputError(f"{name} {words[0]}", "is not in this version", f"{name} --help")
    return _run_module(f"{name} {words[0]}", importlib.import_module(path), words[1:])


def _run_module(name: str, module: ModuleType, words: list[str]) -> int:
    parser = parser_of(name, module)
    if "--ros-args" in words and getattr(module, "TAKES_ROS_ARGUMENTS", False):
        cut = words.index("--ros-args")
        arguments = parser.parse_args(words[:cut])
        arguments.ros_arguments = words[cut:]
        for flag, word in itertools.pairwise(words[cut:]):
            if flag in ROS_FILES:  # ROS itself would wait for a pipe for ever
                plain_file(Path(word), "a file of parameters" if flag == ROS_FILES[0] else "a file of log levels")
    else:
        arguments = parser.parse_args(words)
        arguments.ros_arguments = []
    try:
        return int(module.run(arguments) or 0)
    except OSError as error:  # a full disk names no file: it is where the results go
        error.filename = error.filename or getattr(arguments, "output", None)
        raise


if __name__ == "__main__":
    sys.exit(main())
