"""Show the running graph of an axis, or of several, on a web page.

It listens and holds up nobody: the graph does not wait for it. Only this machine reaches the page. Others do with --host ADDRESS
and a token, which is typed in once; they may only look, unless --control is given. From afar: ssh -L 8642:localhost:8642 MACHINE
Several axes are named as for `graph`: ./tcs live azimuth_1p2m.yaml altitude_1p2m.yaml
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from tcs_friction.commands.parser import name_word
from tcs_friction.errors import InputError
from tcs_friction.nodes.entry import end_at_once, hear_over_udp, keep_logs, stay_local

TAKES_ROS_ARGUMENTS = True
PORT = 8642
ENDING = 10.0  # s that the page of a graph gets to end


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    axis = "azimuth_1p2m.yaml"
    parser.add_argument("axis", nargs="*", default=[axis], metavar="AXIS.yaml", help=f"axis files (default: {axis})")
    parser.add_argument("--port", type=port_number, default=PORT, help="of the page; 0: any that is free (default: %(default)s)")
    parser.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="address to serve (default: %(default)s)")
    parser.add_argument("--token-file", default="", metavar="FILE", help="file with the token; else the variable TCS_LIVE_TOKEN")
    parser.add_argument("--control", action="store_true", help="with --host: others may give orders, too")
    known = "another name by which the page is reached; may be repeated"
    parser.add_argument("--name", type=name_word, action="append", default=[], metavar="NAME", help=known)
    shown = "directory whose recordings and reports are listed: the nodes' parameter `results` (default: %(default)s)"
    parser.add_argument("--results", type=Path, default=Path("results"), metavar="DIR", help=shown)


def run(arguments: argparse.Namespace) -> int:
    """Show the page."""
    check_packages()
    from tcs_friction.live.access import access

    rules = access(arguments.host, arguments.token_file, arguments.control, tuple(arguments.name))
    end_at_once()
    stay_local()
    hear_over_udp()
    keep_logs()
    try:
        from tcs_friction.live.process import serve
    except ModuleNotFoundError as error:
        raise InputError("live", f"needs ROS 2 ({error})", "./tcs on a machine with a C and a C++ compiler") from None
    return serve(arguments.axis, arguments.ros_arguments, rules, arguments.port, arguments.results)


def check_packages() -> None:
    """Raises InputError where what the page is served with is not installed."""
    for name in ("starlette", "uvicorn", "websockets"):
        if importlib.util.find_spec(name) is None:
            how = "./tcs live, which installs it, or pip install -r requirements/live.txt"
            raise InputError("live", f"needs a package that is not installed ({name})", how)


@contextlib.contextmanager
def beside(axes: Sequence[str], ros_arguments: Sequence[str], port: int) -> Iterator[None]:
    """The page of a graph that runs in the block, in a process of its own that is not real-time. It ends with the block."""
    from tcs_friction.nodes.core.scheduling import ASKED
    from tcs_friction.nodes.graph import end_with_parent

    given = [word.partition(":=")[2] for word in ros_arguments if word.startswith("results:=")]
    words = [*axes, "--port", str(port), *(["--results", given[-1]] if given else []), *ros_arguments]
    environment = {name: value for name, value in os.environ.items() if name != ASKED}
    command = [sys.executable, "-P", "-m", "tcs_friction.cli", "live", *words]
    process = subprocess.Popen(command, env=environment, preexec_fn=end_with_parent)
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(ENDING)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def port_number(word: str) -> int:
    """A port of the command line."""
    if not (word.isdecimal() and len(word) <= 5 and int(word) < 1 << 16):
        raise argparse.ArgumentTypeError(f"{word[:9]!r} is no port (0 to 65535)")
    return int(word)
