"""XML of other people, changed where it has to be and nowhere else: comments, order, quotes and blanks stay."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from tcs_friction.errors import InputError

LARGEST = 64 << 20
"""Characters of a model; scenes with many meshes name them and do not hold them."""
DEEPEST = 400
"""Tags within each other, at which the reader would leave the stack."""


@dataclass
class Element:
    """A tag in the text: bytes from `start` to `open_end` are its start tag, its end tag begins at `close` and ends at `end`."""

    tag: str
    attributes: Mapping[str, str]
    start: int
    open_end: int = 0
    close: int = 0
    end: int = 0
    children: list[Element] = field(default_factory=list)

    def walk(self) -> Iterator[Element]:
        """It and all below it, in the order of the text."""
        yield self
        for child in self.children:
            yield from child.walk()

    def all(self, tag: str) -> list[Element]:
        """Everything below it with that tag."""
        return [one for one in self.walk() if one.tag == tag and one is not self]

    def get(self, tag: str) -> Element | None:
        """Its first child with that tag."""
        return next((child for child in self.children if child.tag == tag), None)


class Document:
    """A text and the changes to it. Raises InputError, beginning with `where`, for what is no XML or has no root `root`."""

    def __init__(self, text: str, where: str, root: str) -> None:
        self.where, self._data = where, text.encode()
        self._edits: list[tuple[int, int, bytes]] = []
        if len(text) > LARGEST:
            raise InputError(where, f"more than {LARGEST >> 20} MiB", "a model")
        self.root = self._parsed()
        if self.root.tag != root:
            raise InputError(where, f"its root is <{self.root.tag[:40]}>", f"<{root}>")

    def _parsed(self) -> Element:
        parser = expat.ParserCreate("utf-8")
        stack: list[Element] = []
        roots: list[Element] = []
        data = self._data

        def start(tag: str, attributes: dict[str, str]) -> None:
            element = Element(tag, attributes, parser.CurrentByteIndex)
            element.open_end = _tag_end(data, element.start)
            (stack[-1].children if stack else roots).append(element)
            stack.append(element)
            if len(stack) > DEEPEST:
                raise InputError(self.where, f"tags {DEEPEST} deep", "a model")

        def end(_: str) -> None:
            element = stack.pop()
            alone = data[: element.open_end].endswith(b"/>")
            element.close = element.open_end if alone else parser.CurrentByteIndex
            element.end = element.open_end if alone else _tag_end(data, element.close)

        def doctype(*_: object) -> None:
            raise InputError(self.where, "has a DOCTYPE", "a model, which has none")

        parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, doctype
        try:
            parser.Parse(data, True)
        except (expat.ExpatError, ValueError, LookupError) as error:
            raise InputError(self.where, f"no XML ({error})", "a model in XML") from None
        root: Element = roots[0]
        return root

    def set(self, element: Element, **values: str) -> None:
        """Attributes of an element: changed where they stand, else added behind the others."""
        tag = self._data[element.start : element.open_end].decode()
        for name, value in values.items():
            found = re.search(rf"(\s{re.escape(name)}\s*=\s*)(\"[^\"]*\"|'[^']*')", tag)
            if found:
                tag = tag[: found.start(2)] + quoteattr(value) + tag[found.end(2) :]
            else:
                inner, end = (tag[:-2], "/>") if tag.endswith("/>") else (tag[:-1], ">")
                tag = f"{inner.rstrip()} {name}={quoteattr(value)}{end}"
        self._edit(element.start, element.open_end, tag)

    def write(self, element: Element, text: str) -> None:
        """The text inside an element that has no children."""
        if self._data[: element.open_end].endswith(b"/>"):
            tag = self._data[element.start : element.open_end].decode()
            self._edit(element.start, element.end, f"{tag[:-2].rstrip()}>{escape(text)}</{element.tag}>")
        else:
            self._edit(element.open_end, element.close, escape(text))

    def text(self, element: Element) -> str:
        """The text inside an element."""
        return self._data[element.open_end : element.close].decode().strip()

    def add(self, element: Element, *lines: str) -> None:
        """Further children, as the last ones."""
        indent = self._indent(element)
        inner = self._indent(element.children[-1]) if element.children else f"{indent}  "
        added = "".join(f"\n{inner}{line}" for line in lines)
        if self._data[: element.open_end].endswith(b"/>"):
            tag = self._data[element.start : element.open_end].decode()
            self._edit(element.start, element.end, f"{tag[:-2].rstrip()}>{added}\n{indent}</{element.tag}>")
            return
        at = element.children[-1].end if element.children else element.open_end
        tail = "" if self._data[at : element.close].find(b"\n") >= 0 else f"\n{indent}"
        self._edit(at, at, added + tail)

    def replace(self, element: Element, text: str) -> None:
        """Another element in its place."""
        self._edit(element.start, element.end, text)

    def remove(self, element: Element) -> None:
        """Takes an element away, and its line with it if nothing else stands there."""
        start, end = element.start, element.end
        line = self._data.rfind(b"\n", 0, start) + 1
        after = self._data.find(b"\n", end)
        if not self._data[line:start].strip() and after >= 0 and not self._data[end:after].strip():
            start, end = line, after + 1
        self._edit(start, end, "")

    def _indent(self, element: Element) -> str:
        before = self._data[: element.start].rpartition(b"\n")[2]
        return before.decode() if not before.strip() else ""

    def _edit(self, start: int, end: int, text: str) -> None:
        self._edits.append((start, end, text.encode()))

    def changed(self) -> str:
        """The text with all changes."""
        data = self._data
        for start, end, text in sorted(self._edits, key=lambda edit: edit[:2], reverse=True):
            data = data[:start] + text + data[end:]
        return data.decode()


def _tag_end(data: bytes, start: int) -> int:
    """Behind the > of the tag that begins at `start`; one in a quoted value is none."""
    found = re.compile(rb"(?:\"[^\"]*\"|'[^']*'|[^\"'>])*>").match(data, start)
    return found.end() if found else len(data)
