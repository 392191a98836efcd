"""Who may look: names of hosts, origins, tokens."""

from __future__ import annotations

from pathlib import Path

import pytest

from tcs_friction.errors import InputError
from tcs_friction.live.access import SHORTEST, VARIABLE, Access, access, host_of, is_loopback, same_origin

TOKEN = "correct-horse-battery-staple"


@pytest.mark.parametrize("name", ["localhost", "localhost:8642", "127.0.0.1:9", "[::1]:8642", "LOCALHOST:1", "127.1.2.3"])
def test_a_loopback_server_is_known_by_the_names_of_the_loopback(name: str) -> None:
    assert Access().knows(name)


@pytest.mark.parametrize(
    "name",
    [None, "", "evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "192.168.1.5:8642", "localhost:80:80",
     "[::1", "[evil]:80", "local host", "localhost/x", "localhost:x", "user@localhost"],
)  # fmt: skip
def test_a_loopback_server_is_not_known_by_other_names(name: str | None) -> None:
    assert not Access().knows(name)


def test_a_server_for_others_is_known_by_addresses_and_by_names_it_was_given() -> None:
    """An attacker's page has a name; with an address nobody's DNS can be asked."""
    rules = Access("0.0.0.0", TOKEN, names=("Mount.Example",))
    for name in ("192.168.1.5:8642", "mount.example", "localhost", "[fe80::1]:8642"):
        assert rules.knows(name), name
    for name in ("evil.example", "mount.example.evil.example"):
        assert not rules.knows(name), name


@pytest.mark.parametrize(
    ("origin", "same"),
    [
        ("http://127.0.0.1:8642", True),
        ("https://127.0.0.1:8642", True),
        ("http://127.0.0.1:8643", False),
        ("http://127.0.0.1", False),
        ("http://evil.example", False),
        ("http://127.0.0.1:8642.evil.example", False),
        ("file://127.0.0.1:8642", False),
        ("null", False),
        ("", False),
        (None, False),
    ],
)
def test_only_the_servers_own_origin_is_its_own(origin: str | None, same: bool) -> None:
    assert same_origin(origin, "127.0.0.1:8642") is same


def test_hosts_are_read_as_browsers_write_them() -> None:
    assert host_of("[::1]:80") == "::1"
    assert host_of("Mount-1.example:80") == "mount-1.example"
    assert is_loopback("::1")
    assert not is_loopback("0.0.0.0")


def test_without_a_token_everybody_who_reaches_the_server_is_welcome() -> None:
    assert Access().welcomes(None, None)
    assert not Access().accepts("")


def test_with_a_token_only_who_knows_it_is_welcome() -> None:
    rules, other = Access(token=TOKEN), Access(token=TOKEN)
    assert rules.accepts(TOKEN)
    assert rules.welcomes(None, f"Bearer {TOKEN}")
    assert rules.welcomes(rules.session, None)
    wrong = ((None, None), ("", ""), (TOKEN, None), (other.session, None), (None, TOKEN), (None, "Bearer "), ("é", "Bearer é"))
    for cookie, header in wrong:
        assert not rules.welcomes(cookie, header), (cookie, header)


def test_others_are_let_in_only_with_a_token_and_may_only_look() -> None:
    with pytest.raises(InputError, match=f"0.0.0.0 can be reached from other machines.*{VARIABLE}"):
        access("0.0.0.0", "", False, (), {})
    assert not access("0.0.0.0", "", False, (), {VARIABLE: TOKEN}).control
    assert access("0.0.0.0", "", True, (), {VARIABLE: TOKEN}).control
    assert access("127.0.0.1", "", False, (), {}).control
    assert access("localhost", "", False, (), {VARIABLE: TOKEN}).token == TOKEN


@pytest.mark.parametrize(
    "token", ["short", "x" * (SHORTEST - 1), "x" * 300, "two words are not a token", "tab\tin the middle of it"]
)
def test_a_token_that_is_none_is_refused_and_not_quoted(token: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no usable token") as caught:
        access("127.0.0.1", "", False, (), {VARIABLE: token})
    assert token not in str(caught.value)
    path = tmp_path / "token"
    path.write_text(token)
    path.chmod(0o600)
    with pytest.raises(InputError, match="no usable token"):
        access("127.0.0.1", str(path), False, (), {})


def test_a_token_file_is_for_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "token"
    with pytest.raises(InputError, match="No such file"):
        access("0.0.0.0", str(path), False, (), {})
    path.write_text(f"{TOKEN}\n")
    path.chmod(0o640)
    with pytest.raises(InputError, match="others may read it"):
        access("0.0.0.0", str(path), False, (), {})
    path.chmod(0o600)
    assert access("0.0.0.0", str(path), False, (), {}).token == TOKEN
    with pytest.raises(InputError, match="is set as well"):
        access("0.0.0.0", str(path), False, (), {VARIABLE: TOKEN})
    path.write_bytes(b"\xff" * 20)
    with pytest.raises(InputError, match="is no text"):
        access("0.0.0.0", str(path), False, (), {})
