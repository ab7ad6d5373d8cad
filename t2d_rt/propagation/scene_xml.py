"""The elements of a Mitsuba/Sionna XML file, read without Mitsuba: bounded, its $parameters filled in, its includes in place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes

MAX_XML_BYTES = 4_000_000
MAX_ELEMENTS = 100_000
MAX_DEPTH = 30
MAX_INCLUDES = MAX_PARAMETERS = 20
MAX_VALUE = 4096
"""Characters of an attribute once its parameters are filled in, which may hold one another."""


@dataclass(slots=True)
class SceneFile:
    """An XML file and its folder, the only one that its meshes and includes may lie in."""

    path: Path
    parameters: dict[str, str] = field(default_factory=dict)
    """Of <default>; the first one of a name counts, as in Mitsuba."""
    elements: int = 0
    includes: int = 0

    def inside(self, name: str | None) -> Path:
        """Path of a file that the scene names, symbolic links followed; it must lie in the scene's folder or below."""
        home = self.path.resolve().parent
        try:
            found = (home / (name or "")).resolve()
        except (OSError, RuntimeError, ValueError):  # links in a ring
            raise InputError(f"it names {shown(name)}, which cannot be found; put the file beside the scene") from None
        if not name or not found.is_relative_to(home):
            raise InputError(f"it names {shown(name)}, which lies outside its folder; put the file beside the scene")
        try:
            there = found.exists()
        except OSError:  # a name longer than names may be
            there = False
        if not there:
            raise InputError(f"it names {shown(name)}, which does not exist; put the file beside the scene")
        return found

    def read(self) -> list[Element]:
        """What <scene> holds, parameters filled in and includes in place of their element."""
        return list(self._read(self.path))

    def _read(self, path: Path) -> Iterator[Element]:
        root = self._tree(read_bytes(path, limit=MAX_XML_BYTES, noun="scene file"))
        if root.tag != "scene":
            raise InputError(
                f"it is not a Mitsuba scene: it begins with <{shown(root.tag)[1:-1]}>, not <scene>; give a Mitsuba XML file"
            )
        for element in root:
            self._fill(element)
            if element.tag == "default":
                self._define(element.get("name", ""), element.get("value", ""))
            elif element.tag == "include":
                self.includes += 1
                if self.includes > MAX_INCLUDES:
                    raise InputError(f"it includes more than {MAX_INCLUDES} files; put them into one")
                yield from self._read(self.inside(element.get("filename")))
            else:
                yield element

    def _tree(self, data: bytes) -> Element:
        """The root of an XML text. No document type, whose entities could grow without bound or name other files."""
        builder, parser = TreeBuilder(), expat.ParserCreate()
        depth = 0

        def start(tag: str, attributes: dict[str, str]) -> None:
            nonlocal depth
            depth += 1
            self.elements += 1
            if depth > MAX_DEPTH or self.elements > MAX_ELEMENTS:
                raise InputError(
                    f"it holds more than {MAX_ELEMENTS} elements or is nested deeper than {MAX_DEPTH} levels; make it simpler"
                )
            builder.start(tag, attributes)

        def end(tag: str) -> None:
            nonlocal depth
            depth -= 1
            builder.end(tag)

        def document_type(*_: object) -> None:
            raise InputError("it has a document type (<!DOCTYPE), which no scene needs; delete it")

        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.StartDoctypeDeclHandler = document_type
        try:
            parser.Parse(data, True)
        except InputError:
            raise
        except (expat.ExpatError, LookupError, ValueError) as error:
            raise InputError(f"it is not XML ({error}); give a Mitsuba XML file") from None
        return builder.close()

    def _define(self, name: str, value: str) -> None:
        if not name or len(value) > MAX_VALUE or len(self.parameters) >= MAX_PARAMETERS:
            raise InputError(
                f"it has a <default> without a name, of more than {MAX_VALUE} characters, or more than {MAX_PARAMETERS} of them; "
                "write the values where they are used"
            )
        self.parameters.setdefault(name, value)

    def _fill(self, element: Element) -> None:
        """Puts the values of $parameters into an element's attributes and those of all that it holds."""
        for each in element.iter():
            for key, value in each.attrib.items():
                if "$" in value:
                    each.set(key, self._filled(value))

    def _filled(self, value: str) -> str:
        for name in sorted(self.parameters, key=len, reverse=True):
            value = value.replace(f"${name}", self.parameters[name]) if len(value) <= MAX_VALUE else value
        if "$" in value or len(value) > MAX_VALUE:
            raise InputError(
                f"it uses a parameter without a <default> before, or one of more than {MAX_VALUE} characters, in "
                f"{shown(value)}; give its value there"
            )
        return value
