"""Which column of a table plays which part: as somebody says, else by what the names say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from tcs_friction.errors import InputError, nearest
from tcs_friction.recording.choice import joint_number, no_joint
from tcs_friction.recording.signals import REQUIRED
from tcs_friction.recording.table import Table
from tcs_friction.recording.table_names import NAMES, Said, joints_of, said

MOST_SHOWN = 12
"""Columns that a message lists."""


@dataclass(frozen=True)
class Role:
    """A signal's column and its unit, "" where nobody says it."""

    column: str
    unit: str = ""


@dataclass(frozen=True)
class Joint:
    """A joint by name or, from 0, by number. asked: whether somebody means one; else it is what an axis file calls its own."""

    name: str = ""
    asked: bool = False


@dataclass
class Roles:
    """columns: signal -> role. joint: the one that is taken, "" where a table names none. left_out: no signals at all.

    renamed: columns of other joints, and what they are called as signals beside this one.
    """

    columns: dict[str, Role] = field(default_factory=dict)
    joint: str = ""
    left_out: set[str] = field(default_factory=set)
    renamed: dict[str, str] = field(default_factory=dict)

    def take(self, signal: str, column: str, unit: str) -> None:
        """Give a column to a signal."""
        self.columns[signal] = Role(column, unit)

    def free(self, columns: Iterable[str]) -> list[str]:
        """Those that play no part."""
        taken = {role.column for role in self.columns.values()}
        return [column for column in columns if column not in taken]


def roles_of(table: Table, chosen: Mapping[str, str], joint: Joint, where: str, notes: list[str]) -> Roles:
    """The roles. Raises InputError where a needed signal has no column, or several and nobody has chosen."""
    told = {column: said(column, table.units.get(column, "")) for column in table.columns}
    roles = Roles()
    for signal, word in chosen.items():
        _choose(roles, signal, word, told, where)
    if table.headless and not {"time", *REQUIRED} <= set(roles.columns):
        raise _headless(table, where)
    _sure(roles, told, where, notes)
    _of_joint(roles, told, joint, where, notes)
    for signal in ("time", *REQUIRED):
        if signal not in roles.columns:
            _likely(roles, signal, told, where, notes)
    for signal in ("velocity", "temperature", "reference"):
        _beside(roles, signal, told)
    roles.left_out.update(column for column in roles.free(told) if told[column].signal == "time")  # a clock pushes on nothing
    for signal in ("time", *REQUIRED):
        if signal not in roles.columns:
            listed = ", ".join([*table.columns][:MOST_SHOWN]) + (", ..." if len(table.columns) > MOST_SHOWN else "")
            expected = f"a column of that name, or --column {signal}=COLUMN with one of {listed}"
            raise InputError(where, f"no {signal}", expected)
    return roles


def joint_names(table: Table, chosen: Mapping[str, str], where: str) -> tuple[str, ...]:
    """The joints that a table's columns name, none where it has one alone. Raises InputError as `roles_of` does."""
    told = {column: said(column, table.units.get(column, "")) for column in table.columns}
    roles = Roles()
    for signal, word in chosen.items():
        _choose(roles, signal, word, told, where)
    if table.headless or {"position", "torque"} & set(roles.columns):
        return ()
    return tuple(joints_of({column: told[column] for column in roles.free(told)}))


def _choose(roles: Roles, signal: str, word: str, told: Mapping[str, Said], where: str) -> None:
    """A column as somebody names it: `NAME`, `NAME:unit`, or its number from 1."""
    if signal not in NAMES:
        raise InputError(where, f"no signal {signal!r}", nearest(signal, NAMES))
    column, unit = _column(word, told), ""
    if column is None and ":" in word:
        name, _, unit = word.rpartition(":")
        column = _column(name, told)
    if column is None:
        raise InputError(where, f"no column {word!r}", nearest(word, told))
    if any(role.column == column for role in roles.columns.values()):
        raise InputError(where, f"column {column!r} chosen for two signals", "a column for each")
    plain = said(column, unit) if unit else told[column]
    roles.take(signal, column, plain.unit)


def _column(word: str, told: Mapping[str, Said]) -> str | None:
    if word in told:
        return word
    names = list(told)
    return names[int(word) - 1] if word.isdecimal() and len(word) < 6 and 1 <= int(word) <= len(names) else None


def _headless(table: Table, where: str) -> InputError:
    first = ", ".join(f"{values[0]:.6g}" for values in [*table.columns.values()][:MOST_SHOWN])
    expected = "--column time=1 --column position=2 --column torque=3, with the numbers of its columns"
    return InputError(where, f"has no heading; its {len(table.columns)} columns begin with {first}", expected)


def _sure(roles: Roles, told: Mapping[str, Said], where: str, notes: list[str]) -> None:
    """Columns that are called like a signal and nothing else. Two for one signal are refused unless one is chosen."""
    for signal in NAMES:
        matches = [column for column in roles.free(told) if told[column].signal == signal and told[column].sure]
        strong = [column for column in matches if not told[column].weak]
        if signal in roles.columns:
            notes.extend(f"column {column!r} left out: {signal} is {roles.columns[signal].column!r}" for column in matches)
            roles.left_out.update(matches)
        elif len(strong or matches) > 1:
            found = f"{len(strong or matches)} columns for {signal}: {' and '.join(map(repr, strong or matches))}"
            raise InputError(where, found, f"one, or --column {signal}=COLUMN")
        elif matches:
            best = (strong or matches)[0]
            roles.take(signal, best, told[best].unit)


def _of_joint(roles: Roles, told: Mapping[str, Said], joint: Joint, where: str, notes: list[str]) -> None:
    """Position, velocity, torque and reference of one of the joints that the names tell, where those are not known yet."""
    joints = joints_of({column: told[column] for column in roles.free(told)})
    if not joints or {"position", "torque"} & set(roles.columns):
        return
    name = _meant(joints, joint, where)
    roles.joint = name
    for column in roles.free(told):
        one = told[column]
        if one.joint == joints[name] and one.signal not in ("", "time") and one.signal not in roles.columns:
            roles.take(one.signal, column, one.unit)
        elif len(joints) > 1 and (other := next((k for k, words in joints.items() if words == one.joint and k != name), "")):
            if one.signal in ("position", "velocity"):
                roles.renamed[column] = f"{'j' if other[0].isdigit() else ''}{other}_{one.signal}"
            else:
                roles.left_out.add(column)
    if len(joints) > 1:
        notes.append(f"joint {name} of {len(joints)}: {', '.join([*joints][:MOST_SHOWN])}")


def _meant(joints: Mapping[str, tuple[str, ...]], joint: Joint, where: str) -> str:
    """The joint by its name, whole or in part, or by its number from 0."""
    words = tuple(part.lower() for part in said_words(joint.name))
    exact = [name for name, own in joints.items() if joint.name == name or (words and own[-len(words) :] == words)]
    if len(exact) == 1:
        return exact[0]
    names = [*joints]
    number = joint_number(joint.name) if joint.asked else None
    if number is not None and number < len(names):
        return names[number]
    if len(names) == 1:
        return names[0]
    listed = ", ".join(f"{number} {name}" for number, name in enumerate(names[:MOST_SHOWN]))
    expected = f"--joint with one of {listed}{', ...' if len(names) > MOST_SHOWN else ''}"
    raise no_joint(joint.name, expected, where) if joint.asked else InputError(where, f"{len(names)} joints", expected)


def said_words(name: str) -> tuple[str, ...]:
    """The words of a joint's name as they are in a column's."""
    return said(f"{name} position").joint if name else ()


def _likely(roles: Roles, signal: str, told: Mapping[str, Said], where: str, notes: list[str]) -> None:
    """The only column whose name has the signal in it; one that a word says before those that currents or units say."""
    likely = [column for column in roles.free(told) if told[column].signal == signal and column not in roles.left_out]
    strong = [column for column in likely if not told[column].weak]
    chosen = strong or likely
    if len(chosen) > 1:
        found = f"{len(chosen)} columns that may be the {signal}: {' and '.join(map(repr, chosen[:MOST_SHOWN]))}"
        raise InputError(where, found, f"one, or --column {signal}=COLUMN")
    for column in chosen:
        roles.take(signal, column, told[column].unit)
        notes.append(f"column {column!r} taken for the {signal}")


def _beside(roles: Roles, signal: str, told: Mapping[str, Said]) -> None:
    """A further signal, if its name has the same words beside it as the position's."""
    if signal in roles.columns or "position" not in roles.columns:
        return
    own = told[roles.columns["position"].column].joint
    same = [c for c in roles.free(told) if own and told[c].signal == signal and told[c].joint == own and c not in roles.left_out]
    if len(same) == 1:
        roles.take(signal, same[0], told[same[0]].unit)
