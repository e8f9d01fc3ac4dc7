"""The ETHERNET configuration file of a KUKA RSI context: which values the controller sends and expects.

The driver is made from the customer's file; nothing about tags, order or types is assumed. Keywords (``DEF_...``,
INDX ``INTERNAL``) stand for what the controller fills in itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal
from xml.etree.ElementTree import Element

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.protocols.xml_file import xml_root

Kind = Literal["DOUBLE", "LONG", "BOOL", "STRING"]
_KINDS: Final = ("DOUBLE", "LONG", "BOOL", "STRING")
_POSE: Final = ("X", "Y", "Z", "A", "B", "C")
_AXES: Final = tuple(f"A{i}" for i in range(1, 7))
_EXTERNAL: Final = tuple(f"E{i}" for i in range(1, 7))
SENT_KEYWORDS: Final[dict[str, tuple[str, ...]]] = {
    "RIst": _POSE,
    "RSol": _POSE,
    "AIPos": _AXES,
    "ASPos": _AXES,
    "EIPos": _EXTERNAL,
    "ESPos": _EXTERNAL,
    "MACur": _AXES,
    "MECur": _EXTERNAL,
    "Delay": ("D",),
    **{f"Tech.C{k}": tuple(f"C{k}{i}" for i in range(1, 11)) for k in range(1, 7)},
    **{f"Tech.T{k}": tuple(f"T{k}{i}" for i in range(1, 11)) for k in range(1, 7)},
}
"""Attributes of what the controller sends by itself."""
RECEIVED_KEYWORDS: Final[dict[str, tuple[str, ...]]] = {
    "EStr": (),
    **{f"Tech.T{k}": tuple(f"T{k}{i}" for i in range(1, 11)) for k in range(1, 7)},
    **{f"Tech.C{k}": tuple(f"C{k}{i}" for i in range(1, 11)) for k in range(1, 7)},
}
"""Attributes of what it takes in by itself."""
MAX_CHANNELS: Final = 64


@dataclass(frozen=True)
class Tag:
    """One ELEMENT of the file."""

    tag: str  # As written: ``DEF_RIst``, ``RKorr.X``, ``Stop``
    kind: Kind  # Its TYPE
    channel: int | None  # INDX 1..64, or None for INTERNAL
    hold: bool = True  # HOLDON: the controller keeps the last value where no valid answer came. Received tags only.

    @classmethod
    def of(cls, element: Element, keywords: dict[str, tuple[str, ...]], place: str) -> Tag:
        """Read a tag of the telegram."""
        tag, kind = element.get("TAG", ""), element.get("TYPE", "").upper()
        parts = tag.removeprefix("DEF_").split(".")
        if not tag or len(parts) > 2 or not all(p.isascii() and p.replace("_", "").isalnum() for p in parts):
            raise FileFormatError("TAG cannot be used", where=place, value=repr(tag), limit="Name or Name.attribute")
        if kind not in _KINDS:
            raise FileFormatError("TYPE is unknown", where=place, value=repr(kind), limit=", ".join(_KINDS))
        if tag.startswith("DEF_") and tag[4:] not in keywords:
            raise FileFormatError("keyword is unknown", where=place, value=tag, limit=", ".join(sorted(keywords)))
        channel, hold = _channel(element.get("INDX", ""), place), element.get("HOLDON", "1")
        if hold not in ("0", "1"):
            raise FileFormatError("HOLDON is neither 0 nor 1", where=place, value=repr(hold))
        return cls(tag, kind, channel, hold == "1")  # type: ignore[arg-type]


@dataclass(frozen=True)
class ConfigValue:
    """One value of a telegram."""

    element: str  # XML element
    attribute: str  # Its attribute, or empty for the element's text
    kind: Kind  # Type
    tag: Tag  # The tag of the file it comes from

    @property
    def name(self) -> str:
        """``RIst.X``, ``Delay.D``, ``Stop``."""
        return f"{self.element}.{self.attribute}" if self.attribute else self.element


@dataclass(frozen=True)
class RsiConfig:
    """A checked configuration file."""

    host: str  # IP_NUMBER: where the controller sends to
    port: int  # PORT
    sentype: str  # Type that the answer must carry
    only_send: bool  # The controller expects no answer
    send: tuple[Tag, ...]  # What it sends, in order
    receive: tuple[Tag, ...]  # What it takes in, in order
    where: str = ""  # Path, for messages

    def sent(self) -> tuple[ConfigValue, ...]:
        """Every value of a ``<Rob>`` telegram in order, without IPOC."""
        return _values(self.send, SENT_KEYWORDS)

    def received(self) -> tuple[ConfigValue, ...]:
        """Every value of a ``<Sen>`` telegram in order, without IPOC."""
        return _values(self.receive, RECEIVED_KEYWORDS)


def read_config(path: str | Path) -> RsiConfig:
    """Read an ETHERNET configuration file.

    Raises:
        FileFormatError: Missing, not XML, an unknown or repeated tag, a type, channel or port out of range.
    """
    return parse_config(file_content.content(path), str(path))


def parse_config(text: bytes, where: str) -> RsiConfig:
    """Check the text of an ETHERNET configuration file. Raises as :func:`read_config`."""
    root = xml_root(text, where)
    if root.tag != "ROOT":
        raise FileFormatError("not an RSI ETHERNET file", where=where, value=f"<{root.tag}>", limit="<ROOT>")
    host = _text(root, "CONFIG/IP_NUMBER", where)
    sentype = _text(root, "CONFIG/SENTYPE", where)
    if not sentype.isascii() or not sentype.isprintable() or set(sentype) & set("<>&\"'"):
        raise FileFormatError("SENTYPE cannot be written into a telegram", where=where, value=repr(sentype))
    port_text = _text(root, "CONFIG/PORT", where)
    if not (port_text.isascii() and port_text.isdigit() and len(port_text) <= 5) or not 1 <= int(port_text) <= 65535:
        raise FileFormatError("PORT is no UDP port", where=where, value=repr(port_text), limit="1 .. 65535")
    only = root.findtext("CONFIG/ONLYSEND", "FALSE").strip().upper()
    if only not in ("TRUE", "FALSE"):
        raise FileFormatError("ONLYSEND is neither TRUE nor FALSE", where=where, value=repr(only))
    send = _tags(root, "SEND", SENT_KEYWORDS, where)
    receive = _tags(root, "RECEIVE", RECEIVED_KEYWORDS, where)
    config = RsiConfig(host, int(port_text), sentype, only == "TRUE", send, receive, where)
    for what, values in (("SEND", config.sent()), ("RECEIVE", config.received())):
        names = [value.name for value in values]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise FileFormatError(f"{what} has a value twice", where=where, value=twice)
    return config


def _text(root: Element, path: str, where: str) -> str:
    text = (root.findtext(path) or "").strip()
    if not text:
        raise FileFormatError(f"{path.replace('/', '.')} is missing", where=where)
    return text


def _tags(root: Element, section: str, keywords: dict[str, tuple[str, ...]], where: str) -> tuple[Tag, ...]:
    tags: list[Tag] = []
    for element in root.findall(f"{section}/ELEMENTS/ELEMENT"):
        name = element.get("TAG", "")
        if name.upper() == "FREE":
            continue
        tag = Tag.of(element, keywords, f"{where}: {section} {name or '?'}")
        if tag.channel is not None and any(tag.channel == other.channel for other in tags):
            raise FileFormatError(
                "the channel is used twice", where=f"{where}: {section} {name or '?'}", value=tag.channel
            )
        tags.append(tag)
    return tuple(tags)


def _channel(index: str, place: str) -> int | None:
    """Number of the channel; None of INTERNAL."""
    if index.upper() == "INTERNAL":
        return None
    if not (index.isascii() and index.isdigit() and len(index) <= 3) or not 1 <= int(index) <= MAX_CHANNELS:
        limit = f"INTERNAL or 1 .. {MAX_CHANNELS}"
        raise FileFormatError("INDX is no channel", where=place, value=repr(index), limit=limit)
    return int(index)


def _values(tags: tuple[Tag, ...], keywords: dict[str, tuple[str, ...]]) -> tuple[ConfigValue, ...]:
    values = []
    for tag in tags:
        if tag.tag.startswith("DEF_"):
            word = tag.tag[4:]
            element = word.split(".")[0]
            attributes = keywords[word]
            kinds = [ConfigValue(element, attribute, tag.kind, tag) for attribute in attributes]
            values += kinds or [ConfigValue(element, "", tag.kind, tag)]
        else:
            element, _, attribute = tag.tag.partition(".")
            values.append(ConfigValue(element, attribute, tag.kind, tag))
    return tuple(values)
