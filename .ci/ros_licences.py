"""Licences of the ROS packages in an environment, as CSV: the wheels' own metadata name none, their package.xml does.

ros_licences.py PREFIX
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from xml.etree import ElementTree


def main() -> None:
    """A line for each package."""
    out = csv.writer(sys.stdout, quoting=csv.QUOTE_ALL)
    out.writerow(["Name", "Version", "License"])
    for path in sorted(Path(sys.argv[1]).glob("share/*/package.xml")):
        package = ElementTree.parse(path).getroot()
        licences = "; ".join(" ".join((item.text or "").split()) for item in package.iter("license"))
        out.writerow([package.findtext("name"), package.findtext("version"), licences])


if __name__ == "__main__":
    main()
