"""XML files of others: parsed whole, without document types, so that no entity is ever expanded."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from trailmark.errors import FormatError
from trailmark.formats.files import read_bytes

__all__ = ["local_name", "read_xml"]


class _DoctypeError(Exception):
    pass


class _NoDoctype(ElementTree.TreeBuilder):
    # The parser calls this before it meets any entity, so that none is ever expanded.
    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise _DoctypeError(f"expected no document type and no entities, got document type {name!r}")


def read_xml(path: Path) -> ElementTree.Element:
    """Return the root element of an XML file.

    Raises:
        FormatError: the file is missing, too large, not XML, or has a document type.
    """
    data = read_bytes(path)
    parser = ElementTree.XMLParser(target=_NoDoctype())  # noqa: S314  # entities are refused above, externals never read
    try:
        parser.feed(data)
        root = parser.close()
    except ElementTree.ParseError as error:
        raise FormatError(path, f"not valid XML: {error.msg.partition(':')[0]}", error.position[0]) from None
    except (_DoctypeError, ValueError, LookupError) as error:  # the latter two: an encoding that is not known
        raise FormatError(path, str(error)) from None
    assert isinstance(root, ElementTree.Element)  # noqa: S101  # what a TreeBuilder returns
    return root


def local_name(element: ElementTree.Element) -> str:
    """Return an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]
