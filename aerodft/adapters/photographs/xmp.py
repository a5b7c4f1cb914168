"""XMP packets of photographs, as a flat table of texts; what is no plain XMP gives an empty one."""

from typing import Final
from xml.parsers import expat

MAX_PACKET_BYTES: Final = 1 << 20
"""Makers' packets take 1 to 10 kB with their padding; in JPEG 64 kB is the most, in TIFF any size."""

MAX_DEPTH: Final = 32
"""Nesting of elements; the deepest of the makers has 8."""

_SEPARATOR: Final = " "
_RDF: Final = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_META: Final = "adobe:ns:meta/"
_PREFIXES: Final = {
    "http://www.dji.com/drone-dji/1.0/": "drone-dji",
    "https://www.skydio.com/drone-skydio/1.0/": "drone-skydio",
    "http://www.parrot.com/drone-parrot/1.0/": "drone-parrot",
    "http://pix4d.com/camera/1.0": "Camera",
    "http://pix4d.com/camera/1.0/": "Camera",
    "http://ns.sensefly.com/Camera/1.0/": "Camera",
    "Camera/": "Camera",
    "http://ns.adobe.com/exif/1.0/": "exif",
    "http://ns.adobe.com/tiff/1.0/": "tiff",
    "http://ns.adobe.com/xap/1.0/": "xmp",
}


class _Refused(Exception):  # noqa: N818 - stops the parser, and goes no farther
    """The packet has what no XMP needs: a document type, entities, or elements without end."""


def parse_xmp(packet: bytes) -> dict[str, str]:
    """Read an XMP packet's values, written as attributes or as elements.

    Args:
        packet: The packet, with whatever stands around its outermost element.

    Returns:
        Texts by ``prefix:Name``, and by ``prefix:Name/Field`` for fields of structures; the prefix is the usual one of
        its namespace, else the packet's own. ``rdf:about`` has what the packet is said to be about. Of items in a list
        the first counts, as of a name that comes twice. Empty for a packet that is damaged, or that declares a document
        type or entities.
    """
    begin, end = packet.find(b"<"), packet.rfind(b">")
    if begin < 0 or end < begin or len(packet) > MAX_PACKET_BYTES:
        return {}
    reader = _PacketReader()
    try:
        reader.parse(packet[begin : end + 1])
    except (expat.ExpatError, _Refused, UnicodeError, ValueError):
        return {}
    return reader.values


class _PacketReader:
    def __init__(self) -> None:
        self.values: dict[str, str] = {}
        self._path: list[str] = []  # names of open elements; empty for those of RDF itself
        self._text: list[str] = []
        self._prefixes = dict(_PREFIXES)

    def parse(self, packet: bytes) -> None:
        parser = expat.ParserCreate("UTF-8", _SEPARATOR)
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = _refuse
        parser.EntityDeclHandler = _refuse
        parser.StartNamespaceDeclHandler = self._declare
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text.append
        parser.Parse(packet, True)

    def _declare(self, prefix: str | None, uri: str) -> None:
        self._prefixes.setdefault(uri, prefix or "")

    def _name(self, expanded: str) -> str:
        """``prefix:Name``; empty for RDF's own elements, which only hold others."""
        uri, _, name = expanded.rpartition(_SEPARATOR)
        return "" if uri in {_RDF, _META} else f"{self._prefixes.get(uri, uri)}:{name}"

    def _start(self, expanded: str, attributes: dict[str, str]) -> None:
        if len(self._path) >= MAX_DEPTH:
            raise _Refused
        self._text.clear()
        self._path.append(self._name(expanded))
        for key, value in attributes.items():
            if name := self._name(key):
                self._put([*self._path, name], value)
            elif key == f"{_RDF}{_SEPARATOR}about":
                self._put(["rdf:about"], value)

    def _end(self, _: str) -> None:
        self._put(self._path, "".join(self._text))
        self._text.clear()
        self._path.pop()

    def _put(self, path: list[str], text: str) -> None:
        names = [name for name in path if name]
        if names and text.strip():
            fields = [name.rpartition(":")[2] for name in names[1:]]
            self.values.setdefault("/".join([names[0], *fields]), text.strip())


def _refuse(*_: object) -> None:
    raise _Refused
