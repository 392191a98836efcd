"""What `./tcs ros KIND VERB ...` runs."""

from __future__ import annotations

import argparse

from tcs_friction.nodes.ros import (
    about_actions,
    about_life_cycles,
    about_parameters,
    about_services,
    about_topics,
)
from tcs_friction.nodes.ros.asker import asking

KINDS = {
    "service": about_services.VERBS,
    "topic": about_topics.VERBS,
    "param": about_parameters.VERBS,
    "lifecycle": about_life_cycles.VERBS,
    "action": about_actions.VERBS,
}


def run(arguments: argparse.Namespace) -> None:
    """Do it. Raises TcsError in one line."""
    with asking() as asker:
        KINDS[arguments.kind][arguments.verb](asker, arguments)
