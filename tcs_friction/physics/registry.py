"""Finds the friction laws and effects: this package's own files and those that other packages offer.

A package adds terms through the entry points `tcs_friction.laws` and `tcs_friction.effects`, each naming a `Term`. One that
cannot be had is named in one line of the log and left out: only an axis file that asks for it is refused.
"""

from __future__ import annotations

import importlib
import logging
import pkgutil
import traceback
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType, ModuleType

from tcs_friction.errors import InputError, nearest, one_line
from tcs_friction.physics import effects as effects_package
from tcs_friction.physics import friction as friction_package
from tcs_friction.physics.terms import Feature, Place, Term

GROUPS = ("tcs_friction.laws", "tcs_friction.effects")


def _own(package: ModuleType) -> list[Term]:
    modules = [
        importlib.import_module(f"{package.__name__}.{m.name}")
        for m in pkgutil.iter_modules(package.__path__)
    ]
    return [module.TERM for module in modules if hasattr(module, "TERM")]


_left_out: dict[str, str] = {}
"""Entry points of other packages that are no terms, and why."""


def _collect(package: ModuleType, group: str) -> Mapping[str, Term]:
    found = {term.id: term for term in _own(package)}
    for entry in entry_points(group=group):
        try:
            term = _loaded(entry)
            if term.id in found:
                raise InputError(_named(entry), f"the name {term.id!r} is taken", "another name")
        except InputError as error:
            _left_out[entry.name] = one_line(f"{error.where}: {error.found}")
            logging.getLogger(__name__).warning("tcs-friction: %s, left out", error)
        else:
            found[term.id] = term
    return MappingProxyType(found)


def _loaded(entry: EntryPoint) -> Term:
    """Raises InputError where another package's code ends in any way, and for what is no term."""
    try:
        term = entry.load()
    except (Exception, SystemExit) as error:  # whatever strangers raise
        raise InputError(_named(entry), f"cannot be loaded ({type(error).__name__}: {error})") from error
    if not isinstance(term, Term):
        raise InputError(_named(entry), f"{entry.value} is a {type(term).__name__}", "a Term")
    return term


def _named(entry: EntryPoint) -> str:
    return f"entry point {entry.name} of {entry.group}"


def raised_by_plug_in(error: BaseException) -> str | None:
    """The entry point in whose package an exception was raised, None for an exception of anybody else."""
    entries = [entry for group in GROUPS for entry in entry_points(group=group)]
    modules = {frame.f_globals.get("__name__") for frame, _ in traceback.walk_tb(error.__traceback__)}
    return next((_named(entry) for entry in entries if entry.module in modules), None)


@cache
def laws() -> Mapping[str, Term]:
    """Friction laws by name."""
    return _collect(friction_package, GROUPS[0])


@cache
def effects() -> Mapping[str, Term]:
    """Effects by name."""
    return _collect(effects_package, GROUPS[1])


def law(name: str, where: str = "axis") -> Term:
    """The friction law of that name; InputError names the nearest known one."""
    return _get(laws(), name, f"{where}: friction law")


def effect(name: str, where: str = "axis") -> Term:
    """The effect of that name; InputError names the nearest known one."""
    return _get(effects(), name, f"{where}: effect")


@cache
def alignment() -> Term:
    """The effect that the known delay of an axis file is: the torque acts later than logged, and nothing else."""
    return next(term for term in effects().values() if term.alignment)


@cache
def offset() -> Term:
    """The effect that is a constant torque, and nothing else."""
    return next(term for term in effects().values() if term.offset)


@cache
def tabulated() -> Term:
    """The effect that is a table: it stands in for what no other one explains."""
    return next(term for term in effects().values() if term.tabulated)


def usual_law(features: frozenset[Feature]) -> Term:
    """The friction law to take for exactly these parts of the friction where nobody names a law."""
    return next(term for term in laws().values() if term.usual and term.features == features)


def compared_laws() -> list[str]:
    """The friction laws that are compared where nobody names any: those that extend no other, by name."""
    return sorted(name for name, term in laws().items() if not term.extends)


def _get(known: Mapping[str, Term], name: str, where: str) -> Term:
    if name not in known and name in _left_out:
        raise InputError(where, f"{name!r} is left out", _left_out[name])
    if name not in known:
        raise InputError(where, f"unknown name {name!r}", nearest(name, sorted(known)))
    assert isinstance(known[name].place, Place)
    return known[name]
