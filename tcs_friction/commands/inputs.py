"""The arguments that every command about recordings takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcs_friction.writable import output_directory


def add_recordings(parser: argparse.ArgumentParser, bags: str, axis: str, axis_required: bool = True) -> None:
    """BAG..., --axis and -o; `bags` and `axis` are what the help says of them."""
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG", help=bags)
    parser.add_argument("--axis", required=axis_required, type=Path, metavar="AXIS.yaml", help=axis)
    parser.add_argument("-o", "--output", required=True, type=output_directory, metavar="DIR", help="where the results go")
