"""On the path of every Python that .ci/run starts: where it was when a signal ended it goes to a file, printed at the end."""

import faulthandler
import os
import sys

if path := os.environ.get("TCS_FRICTION_CRASHES"):
    try:
        faulthandler.enable(os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT))
        faulthandler.enable = lambda *_, **__: None  # rclpy's events executor enables it anew, to stderr
    except OSError as error:
        print(f"{path}: {error.strerror}: crashes of this process will not be told", file=sys.stderr)
