"""Kernels in C99: a term is written once, in Python, also for firmware.

The subset is that of kernels: numbers, arrays of them, `if`, `for` over a range or a tuple, functions compiled by numba. What
else a kernel of another package has is refused by name.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from tcs_friction.errors import JobError
from tcs_friction.physics import motion as slots
from tcs_friction.physics.terms import Kernel

SLOTS = {name: value for name, value in vars(slots).items() if name.isupper() and isinstance(value, int)}
MATH = {"exp", "log", "sqrt", "sin", "cos", "tan", "atan", "atan2", "tanh", "pow", "floor", "ceil", "copysign"}
OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "/", ast.Mod: "%"}
COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
REAL, INT, ARRAY = "real", "int", "array"
RESERVED = """
auto break case char const continue default do double enum extern float for goto inline int long register restrict return short
signed sizeof static struct switch typedef union unsigned void volatile while class new this private public template real
"""
HELPERS = {
    "lesser": "static real lesser(real a, real b) { return (b < a) ? b : a; }",
    "greater": "static real greater(real a, real b) { return (b > a) ? b : a; }",
    "lesser_int": "static int lesser_int(int a, int b) { return (b < a) ? b : a; }",
    "greater_int": "static int greater_int(int a, int b) { return (b > a) ? b : a; }",
}


def number(value: float) -> str:
    """A real literal that is read back exactly."""
    return f"REAL({float(value)!r})"


def bare(text: str) -> str:
    """An expression without the parentheses around all of it."""
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and k < len(text) - 1:
            return text
    return text[1:-1] if text.startswith("(") else text


@dataclass
class Translated:
    """A function in C: what it is called, returns (`real`, `int` or how many reals), takes, which arrays it changes, its text."""

    name: str
    result: str | int
    arguments: tuple[tuple[str, str], ...]
    changes: frozenset[str]
    text: str


@dataclass
class Library:
    """The functions of a C file, each once, in the order in which they need one another."""

    done: dict[object, Translated] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """All of them, with the structures they return and the helpers they need."""
        body = "\n\n".join(one.text for one in self.done.values())
        tuples = sorted({one.result for one in self.done.values() if isinstance(one.result, int)})
        parts = [f"typedef struct {{ real part[{n}]; }} real{n};" for n in tuples]
        return "\n\n".join([*parts, *(text for name, text in HELPERS.items() if f"{name}(" in body), body])

    def kernel(self, kernel: Kernel) -> Translated:
        """A term's kernel. Of its arguments it has those that it uses, and how long its state is, if it asks.

        Raises JobError for what is not translated.
        """
        return self.function(kernel, (ARRAY, ARRAY, ARRAY, REAL))

    def function(self, function: Any, kinds: tuple[str, ...]) -> Translated:
        """A function compiled by numba, called with arguments of these kinds."""
        python: Callable[..., Any] = getattr(function, "py_func", function)
        key = python, kinds
        if key not in self.done:
            try:
                tree = ast.parse(textwrap.dedent(inspect.getsource(python))).body[0]
            except (OSError, TypeError, SyntaxError):
                raise JobError(f"C of {python.__module__}.{python.__name__}", "its source is not to be had") from None
            assert isinstance(tree, ast.FunctionDef)
            own = python.__module__.rpartition(".")[2].lstrip("_")
            taken = {one.name for one in self.done.values()}
            name = f"{own}_{python.__name__.lstrip('_')}"
            while name in taken:
                name += "_"
            writer = _Writer(self, python, tree, kinds)
            self.done[key] = writer.translated(name)
        return self.done[key]


class _Writer:
    """One function: the kinds of its variables first, then its text."""

    def __init__(self, library: Library, python: Callable[..., Any], tree: ast.FunctionDef, kinds: tuple[str, ...]) -> None:
        self.library, self.python, self.tree = library, python, tree
        words = [argument.arg for argument in tree.args.args]
        if len(words) != len(kinds):
            raise self.refused(tree, "its arguments")
        self.arguments = dict(zip(words, kinds, strict=True))
        self.locals: dict[str, str] = {}
        self.used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
        self.lengths: set[str] = set()
        self.written: set[str] = set()
        self.result: str | int = REAL
        self.depth = 0
        self.count = 0

    def refused(self, node: ast.AST, what: str) -> JobError:
        line = getattr(node, "lineno", 0)
        return JobError(f"C of {self.python.__module__}.{self.python.__name__}", f"{what} in line {line} is not translated")

    def translated(self, name: str) -> Translated:
        for _ in range(3):  # kinds of variables that others follow from
            self.count, self.depth = 0, 1
            lines = [line for statement in self.tree.body for line in self.statement(statement)]
        arguments = [(word, kind) for word, kind in self.arguments.items() if word in self.used]
        declared = []
        for word, kind in arguments:
            const = "" if word in self.written or kind != ARRAY else "const "
            declared.append(f"{const}{REAL if kind == ARRAY else kind} {'*' if kind == ARRAY else ''}{self.name(word)}")
            if word in self.lengths:
                declared.append(f"int {self.name(word)}_size")
        lengths = [(f"{word}_size", INT) for word, _ in arguments if word in self.lengths]
        kind = f"real{self.result}" if isinstance(self.result, int) else self.result
        head = f"static {kind} {name}({', '.join(declared) or 'void'})"
        used = {word: kind for word, kind in self.locals.items() if word in self.used}
        variables = [f"    {kind} {self.name(word)} = {'0' if kind == INT else number(0.0)};" for word, kind in used.items()]
        ordered = [entry for word, kind in arguments for entry in
                   ((word, kind), *(pair for pair in lengths if pair[0] == f"{word}_size"))]  # fmt: skip
        return Translated(
            name, self.result, tuple(ordered), frozenset(self.written), "\n".join([head, "{", *variables, *lines, "}"])
        )

    def name(self, word: str) -> str:
        return f"{word}_" if word in RESERVED.split() or word in SLOTS else word

    def line(self, text: str) -> str:
        return "    " * self.depth + text

    def block(self, head: str, statements: list[ast.stmt], first: str = "") -> list[str]:
        opening = self.line(f"{head} {{")
        self.depth += 1
        inner = [self.line(first)] if first else []
        inner += [line for statement in statements for line in self.statement(statement)]
        self.depth -= 1
        return [opening, *inner, self.line("}")]

    def statement(self, node: ast.stmt) -> list[str]:
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                return []
            case ast.Expr(value=ast.Call() as call):
                return [self.line(f"(void){self.expression(call)[0]};")]
            case ast.Assign(targets=[target], value=value):
                return self.assign(target, value)
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                return self.assign(target, value)
            case ast.AugAssign(target=target, op=operator, value=value):
                load: ast.expr = ast.parse(ast.unparse(target), mode="eval").body
                return self.assign(target, ast.copy_location(ast.BinOp(left=load, op=operator, right=value), node))
            case ast.If(test=test, body=body, orelse=otherwise):
                lines = self.block(f"if ({bare(self.expression(test)[0])})", body)
                return lines + (self.block("else", otherwise) if otherwise else [])
            case ast.For(target=ast.Name(id=word), iter=iterated, body=body, orelse=[]):
                return self.loop(word, iterated, body)
            case ast.Return(value=ast.Tuple(elts=parts)):
                self.result = len(parts)
                box = self.fresh("result")
                values = [self.line(f"    {box}.part[{k}] = {self.real(part)};") for k, part in enumerate(parts)]
                return [self.line("{"), self.line(f"    real{len(parts)} {box};"), *values,
                        self.line(f"    return {box};"), self.line("}")]  # fmt: skip
            case ast.Return(value=ast.expr() as value):
                text, kind = self.expression(value)
                self.result = kind
                return [self.line(f"return {bare(text)};")]
            case _:
                raise self.refused(node, type(node).__name__)

    def fresh(self, word: str) -> str:
        self.count += 1
        return f"{word}_{self.count}"

    def loop(self, word: str, iterated: ast.expr, body: list[ast.stmt]) -> list[str]:
        counter = self.fresh("step")
        match iterated:
            case ast.Call(func=ast.Name(id="range"), args=[*bounds]) if len(bounds) in (1, 2):
                start, stop = (["0"] if len(bounds) == 1 else []) + [self.expression(bound)[0] for bound in bounds]
                self.locals[word] = INT
                first = f"{self.name(word)} = {counter};" if word in self.used else ""
                return self.block(f"for (int {counter} = {start}; {counter} < {stop}; {counter}++)", body, first)
            case ast.Tuple(elts=parts):
                self.locals[word] = REAL
                values = ", ".join(self.real(part) for part in parts)
                table = self.line(f"static const real {counter}_of[{len(parts)}] = {{{values}}};")
                head = f"for (int {counter} = 0; {counter} < {len(parts)}; {counter}++)"
                return [table, *self.block(head, body, f"{self.name(word)} = {counter}_of[{counter}];")]
            case _:
                raise self.refused(iterated, "a loop over anything but a range or a tuple")

    def assign(self, target: ast.expr, value: ast.expr) -> list[str]:
        match target, value:
            case ast.Tuple(elts=targets), ast.Tuple(elts=values):
                held = [(one, self.fresh("next"), *self.expression(part)) for one, part in zip(targets, values, strict=True)]
                before = [self.line(f"    const {kind} {box} = {text};") for _, box, text, kind in held]
                after = [f"    {line}" for one, box, _, kind in held for line in self.store(one, box, kind)]
                return [self.line("{"), *before, *after, self.line("}")]
            case ast.Tuple(elts=targets), ast.Subscript(value=ast.Name(id=word), slice=ast.Slice(lower=None)):
                return [line for k, one in enumerate(targets) for line in self.store(one, f"{self.name(word)}[{k}]", REAL)]
            case ast.Tuple(elts=targets), ast.Call():
                text, kind = self.expression(value)
                box = self.fresh("pair")
                lines = [line for k, one in enumerate(targets) for line in self.store(one, f"{box}.part[{k}]", REAL)]
                inner = [f"    {line}" for line in lines]
                return [self.line("{"), self.line(f"    const {kind} {box} = {text};"), *inner, self.line("}")]
            case ast.Subscript(value=ast.Name(id=word), slice=ast.Slice(lower=lower, upper=None)), _:
                self.lengths.add(word)
                self.written.add(word)
                counter, start = self.fresh("step"), self.expression(lower)[0] if lower else "0"
                head = f"for (int {counter} = {start}; {counter} < {self.name(word)}_size; {counter}++)"
                return [
                    self.line(f"{head} {{"),
                    self.line(f"    {self.name(word)}[{counter}] = {self.real(value)};"),
                    self.line("}"),
                ]
            case _:
                return self.store(target, *self.expression(value))

    def store(self, target: ast.expr, text: str, kind: str) -> list[str]:
        match target:
            case ast.Name(id=word):
                if word in self.arguments and self.arguments[word] != kind:
                    raise self.refused(target, f"another kind of number for {word}")
                if word not in self.arguments:
                    self.locals[word] = REAL if REAL in (kind, self.locals.get(word)) else kind
                if word not in self.used:
                    return []
                cast = "(real)" if self.locals.get(word) == REAL and kind == INT else ""
                return [self.line(f"{self.name(word)} = {cast}{text if cast else bare(text)};")]
            case ast.Subscript(value=ast.Name(id=word)):
                self.written.add(word)
                place = self.expression(target)[0]
                return [self.line(f"{place} = {f'(real){text}' if kind == INT else bare(text)};")]
            case _:
                raise self.refused(target, "such an assignment")

    def real(self, node: ast.expr) -> str:
        text, kind = self.expression(node)
        return text if kind == REAL else f"(real){text}"

    def expression(self, node: ast.expr) -> tuple[str, str]:
        """Text and kind of an expression."""
        match node:
            case ast.Constant(value=bool() as value):
                return str(int(value)), INT
            case ast.Constant(value=int() as value):
                return str(value), INT
            case ast.Constant(value=float() as value):
                return number(value), REAL
            case ast.Name(id=word):
                return self.word(node, word)
            case ast.Attribute(value=ast.Name(id="math"), attr="pi"):
                return number(math.pi), REAL
            case ast.Subscript(value=ast.Name(id=word), slice=index):
                if self.arguments.get(word) != ARRAY:
                    raise self.refused(node, f"the name {word}")
                return f"{self.name(word)}[{self.expression(index)[0]}]", REAL
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                text, kind = self.expression(operand)
                return f"(-{text})", kind
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return f"(!{self.expression(operand)[0]})", INT
            case ast.BoolOp(op=operator, values=values):
                joined = (" && " if isinstance(operator, ast.And) else " || ").join(self.expression(one)[0] for one in values)
                return f"({joined})", INT
            case ast.IfExp(test=test, body=body, orelse=otherwise):
                kinds = {self.expression(one)[1] for one in (body, otherwise)}
                left, right = (self.real(one) if REAL in kinds else self.expression(one)[0] for one in (body, otherwise))
                return f"({self.expression(test)[0]} ? {left} : {right})", REAL if REAL in kinds else INT
            case ast.Compare(left=first, ops=operators, comparators=others):
                return self.compared([first, *others], operators), INT
            case ast.BinOp(left=left, op=operator, right=right):
                return self.operation(node, left, operator, right)
            case ast.Call(func=function, args=arguments, keywords=[]):
                return self.call(node, function, arguments)
            case _:
                raise self.refused(node, type(node).__name__)

    def word(self, node: ast.expr, word: str) -> tuple[str, str]:
        if word in self.arguments:
            return self.name(word), self.arguments[word]
        if word in self.locals:
            return self.name(word), self.locals[word]
        value = self.python.__globals__.get(word)
        if SLOTS.get(word) == value and value is not None:
            return f"SLOT_{word}", INT
        if isinstance(value, bool | int):
            return str(int(value)), INT
        if isinstance(value, float):
            return number(value), REAL
        raise self.refused(node, f"the name {word}")

    def compared(self, values: list[ast.expr], operators: list[ast.cmpop]) -> str:
        parts = []
        for left, operator, right in zip(values, operators, values[1:], strict=False):
            sign = COMPARISONS.get(type(operator))
            if sign is None:
                raise self.refused(left, type(operator).__name__)
            whole = {self.expression(one)[1] for one in (left, right)} == {INT}
            sides = [self.expression(one)[0] if whole else self.real(one) for one in (left, right)]
            parts.append(f"({sides[0]} {sign} {sides[1]})")
        return parts[0] if len(parts) == 1 else f"({' && '.join(parts)})"

    def operation(self, node: ast.expr, left: ast.expr, operator: ast.operator, right: ast.expr) -> tuple[str, str]:
        kinds = {self.expression(one)[1] for one in (left, right)}
        if isinstance(operator, ast.Pow):
            if isinstance(right, ast.Constant) and right.value == 2:
                return f"({self.real(left)} * {self.real(left)})", REAL
            return f"MATH(pow)({self.real(left)}, {self.real(right)})", REAL
        sign = OPERATORS.get(type(operator))
        whole = kinds == {INT} and not isinstance(operator, ast.Div)
        if sign is None or (isinstance(operator, ast.FloorDiv | ast.Mod) and not whole):
            raise self.refused(node, type(operator).__name__)
        sides = [self.expression(one)[0] if whole else self.real(one) for one in (left, right)]
        return f"({sides[0]} {sign} {sides[1]})", INT if whole else REAL

    def call(self, node: ast.expr, function: ast.expr, arguments: list[ast.expr]) -> tuple[str, str]:
        match function:
            case ast.Attribute(value=ast.Name(id="math" | "np"), attr=word) if word in MATH:
                text = f"MATH({word})({', '.join(self.real(one) for one in arguments)})"
                return (f"((int){text})", INT) if word in ("floor", "ceil") else (text, REAL)
            case ast.Name(id="float"):
                return self.real(arguments[0]), REAL
            case ast.Name(id="int" | "bool" as word):
                text, kind = self.expression(arguments[0])
                return (text if kind == INT else f"((int){text})" if word == "int" else f"({text} != {number(0.0)})"), INT
            case ast.Name(id="abs"):
                return f"MATH(fabs)({self.real(arguments[0])})", REAL
            case ast.Name(id="len") if isinstance(arguments[0], ast.Name):
                self.lengths.add(arguments[0].id)
                return f"{self.name(arguments[0].id)}_size", INT
            case ast.Name(id="min" | "max" as word) if len(arguments) == 2:
                whole = {self.expression(one)[1] for one in arguments} == {INT}
                sides = ", ".join(self.expression(one)[0] if whole else self.real(one) for one in arguments)
                return f"{'lesser' if word == 'min' else 'greater'}{'_int' if whole else ''}({sides})", INT if whole else REAL
            case ast.Name(id=word) if hasattr(self.python.__globals__.get(word), "py_func"):
                return self.other(self.python.__globals__[word], arguments)
            case _:
                raise self.refused(node, f"{ast.unparse(function)}()")

    def other(self, function: Any, arguments: list[ast.expr]) -> tuple[str, str]:
        """A call of another compiled function."""
        kinds = tuple(self.expression(one)[1] for one in arguments)
        words = list(inspect.signature(function.py_func).parameters)
        found = self.library.function(function, kinds)
        given: Mapping[str, ast.expr] = dict(zip(words, arguments, strict=True))
        taken = []
        for word, _ in found.arguments:
            if word in given:
                taken.append(self.expression(given[word])[0])
                continue
            owner = given[word.removesuffix("_size")]
            assert isinstance(owner, ast.Name)
            self.lengths.add(owner.id)
            taken.append(f"{self.name(owner.id)}_size")
        self.written |= {target.id for word in found.changes if isinstance(target := given[word], ast.Name)}
        kind = f"real{found.result}" if isinstance(found.result, int) else found.result
        return f"{found.name}({', '.join(taken)})", kind
