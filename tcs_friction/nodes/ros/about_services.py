"""`service list|type|call`."""

from __future__ import annotations

import argparse

from tcs_friction.nodes.ros.asker import Asker, absolute, print_names
from tcs_friction.nodes.ros.interface_values import from_yaml, interface

AT_ONCE = 0.25  # s


def list_services(asker: Asker, arguments: argparse.Namespace) -> None:
    """Names, with types if wanted."""
    print_names(asker.settled(asker.services), arguments.show_types, arguments.count)


def type_of_service(asker: Asker, arguments: argparse.Namespace) -> None:
    """The type by which it is called."""
    print("\n".join(asker.types("service", absolute(arguments.name), asker.services)))


def call_service(asker: Asker, arguments: argparse.Namespace) -> None:
    """Request and response as they are written in Python; it waits for the service as long as it takes."""
    kind = interface(arguments.type, "srv")
    request = from_yaml(kind.Request, arguments.values)
    name = absolute(arguments.name)
    client = asker.node.create_client(kind, name)
    if not asker.ready(client, AT_ONCE):
        print("waiting for service to become available...", flush=True)
        asker.ready(client)
    print(f"requester: making request: {request!r}\n", flush=True)
    future = client.call_async(request)
    asker.until(future.done)
    print(f"response:\n{future.result()!r}\n")


VERBS = {"list": list_services, "type": type_of_service, "call": call_service}
