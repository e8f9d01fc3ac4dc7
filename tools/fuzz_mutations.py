"""Seeded mutations of telegrams: what transmission, firmware and malice make of them."""

from __future__ import annotations

import random
import re
from typing import Final

LARGEST: Final = 65_507
"""Bytes of the longest UDP datagram."""
_NUMBER: Final = re.compile(rb"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_TAG: Final = re.compile(rb"<[^<>]*>")
_ATTRIBUTE: Final = re.compile(rb"\w+\s*=\s*(?:\"[^\"]*\"|'[^']*')")
NUMBERS: Final = (
    b"", b"-", b"+", b".", b"-.", b"1.", b".5", b"0", b"-0", b"00012", b"1e", b"1e+", b"1e5", b"-1.5E-3",
    b"1e22", b"1e23", b"1e-22", b"1e308", b"1e-400", b"nan", b"NaN", b"inf", b"-Infinity", b"0x10", b"1_000",
    b"1,5", b"1 2", b" 1", b"1 ", b"9" * 15, b"9" * 18, b"9" * 19, b"1" * 400, b"0." + b"0" * 60 + b"1",
    b"1000000000000000", b"1000000000000001", b"18446744073709551616", b"4294967295", b"4294967296",
    b"2147483648", b"-2147483649", b"\xd9\xa1", b"1\x00", b"--1", b"1.2.3", b"0.1", b"123456789.123456789",
)  # fmt: skip
"""Texts in the place of a number."""
PIECES: Final = (
    b"<", b">", b"/", b"/>", b"</", b'"', b"'", b"=", b"&", b"&amp;", b"&#49;", b"<!--x-->", b"<![CDATA[1]]>",
    b"]]>", b"<?x?>", b'<?xml version="1.0"?>', b"<!DOCTYPE a>", b"\0", b" ", b"\t", b"\r\n", b"\x0b", b"\x7f",
    b"\x80", b"\xff", b"\xef\xbb\xbf", b"\xc3\xa4", b"<A/>", b"<A>1</A>", b'<A b="1"/>', b'<A b="1" b="2"/>',
    b"<IPOC>1</IPOC>", b"IPOC", b"Rob", b"Sen", b'X="1"', b' X="1"', b' Q="&lt;"', b"<a:b/>", b'xmlns="u"',
    b"e", b"-", b".",
)  # fmt: skip
"""Texts that come in anywhere."""
_WORDS: Final = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x80010000)
_DOUBLES: Final = (
    b"\0\0\0\0\0\0\xf8\x7f", b"\0\0\0\0\0\0\xf0\x7f", b"\0\0\0\0\0\0\xf0\xff", b"\1\0\0\0\0\0\0\0", b"\xff" * 8,
    b"\0" * 8, b"\0\0\0\0\0\0\xf0\x3f", b"\xff\xff\xff\xff\xff\xff\xef\x7f", b"\0\0\0\0\0j\x08A",
    b"\1\0\0\0\0j\x08A",
)  # fmt: skip


class Mutator:
    """Makes damaged telegrams from good ones.

    Args:
        seed: The same seed makes the same telegrams from the same corpus.
        text: The protocol is text; else binary.
    """

    def __init__(self, seed: int, *, text: bool) -> None:
        self._random = random.Random(seed)
        common = [self._flip, self._byte, self._cut, self._delete, self._repeat, self._swap, self._grow]
        own = [self._number, self._number, self._piece, self._piece, self._tag, self._attribute]
        binary = [self._word, self._word, self._double, self._double, self._field]
        self._ways = common + (own if text else binary)

    def choose(self, corpus: list[bytes]) -> bytes:
        """One of the corpus, the newer half twice as often."""
        n = len(corpus)
        return corpus[
            self._random.randrange(n) if self._random.random() < 0.5 else n - 1 - self._random.randrange((n + 1) // 2)
        ]

    def __call__(self, data: bytes, other: bytes) -> bytes:
        """A damaged telegram.

        Args:
            data: What is damaged.
            other: What parts can be taken from.
        """
        out = bytearray(data)
        pick = self._random
        if pick.random() < 0.05 and other:
            at, begin = pick.randrange(len(out) + 1), pick.randrange(len(other))
            out[at:] = other[begin:]
        for _ in range(1 + int(pick.random() ** 3 * 6)):
            self._ways[int(pick.random() * len(self._ways))](out)
        return bytes(out[:LARGEST])

    def _at(self, out: bytearray) -> int:
        return int(self._random.random() * (len(out) + 1))

    def _flip(self, out: bytearray) -> None:
        if out:
            out[int(self._random.random() * len(out))] ^= 1 << self._random.randrange(8)

    def _byte(self, out: bytearray) -> None:
        if out:
            out[int(self._random.random() * len(out))] = self._random.randrange(256)

    def _cut(self, out: bytearray) -> None:
        del out[self._at(out) :]

    def _delete(self, out: bytearray) -> None:
        at = self._at(out)
        del out[at : at + 1 + int(self._random.random() ** 2 * 24)]

    def _repeat(self, out: bytearray) -> None:
        at = self._at(out)
        piece = out[at : at + 1 + int(self._random.random() ** 2 * 60)]
        to = self._at(out) if self._random.random() < 0.5 else at
        out[to:to] = piece

    def _swap(self, out: bytearray) -> None:
        a, b = sorted((self._at(out), self._at(out)))
        size = 1 + self._random.randrange(8)
        out[a : a + size], out[b : b + size] = out[b : b + size], out[a : a + size]

    def _grow(self, out: bytearray) -> None:
        """Rarely: huge."""
        if self._random.random() < 0.02 and out:
            at = self._at(out)
            piece = bytes(out[at : at + 1 + self._random.randrange(20)]) or b"9"
            out[at:at] = piece * self._random.randrange(1, 2000)

    def _piece(self, out: bytearray) -> None:
        at = self._at(out)
        out[at : at + self._random.choice((0, 0, 0, 1, 3))] = self._random.choice(PIECES)

    def _one_of(self, pattern: re.Pattern[bytes], out: bytearray) -> tuple[int, int]:
        """Place of a match at or behind a random place; nothing where there is none."""
        found = pattern.search(out, self._at(out)) or pattern.search(out)
        return found.span() if found else (0, 0)

    def _number(self, out: bytearray) -> None:
        a, b = self._one_of(_NUMBER, out)
        if a == b:
            return
        pick = self._random.random()
        if pick < 0.4:
            out[a:b] = self._random.choice(NUMBERS)
        elif pick < 0.8:
            out[a:b] = repr(self._random.uniform(-1.0, 1.0) * 10.0 ** self._random.randint(-8, 9)).encode()
        else:
            out[a:b] = f"{self._random.randint(-10, 10 ** self._random.randint(1, 20))}".encode()

    def _tag(self, out: bytearray) -> None:
        """Repeat, move, remove, or nest a tag."""
        a, b = self._one_of(_TAG, out)
        piece = bytes(out[a:b])
        way = self._random.randrange(4)
        if way == 0:
            out[b:b] = piece
        elif way == 1:
            del out[a:b]
        else:
            if way == 2:
                del out[a:b]
            c, _ = self._one_of(_TAG, out)
            out[c:c] = piece

    def _attribute(self, out: bytearray) -> None:
        a, b = self._one_of(_ATTRIBUTE, out)
        piece = bytes(out[a:b])
        if self._random.random() < 0.5:
            out[b:b] = b" " + piece
            return
        del out[a:b]
        c, _ = self._one_of(_ATTRIBUTE, out)
        out[c:c] = piece + b" "

    def _word(self, out: bytearray) -> None:
        if not out:
            return
        at = self._random.randrange(len(out))
        at -= at % self._random.choice((1, 2, 4))
        value = self._random.choice(_WORDS) if self._random.random() < 0.6 else self._random.getrandbits(32)
        out[at : at + 4] = value.to_bytes(4, self._random.choice(("big", "little")))

    def _double(self, out: bytearray) -> None:
        at = 8 * self._random.randrange(len(out) // 8 + 1)
        at += self._random.choice((0, 0, 0, 1, 2, 4))
        out[at : at + 8] = self._random.choice(_DOUBLES)

    def _field(self, out: bytearray) -> None:
        """A length or key of a binary message, a little off."""
        if out:
            at = self._random.randrange(len(out))
            out[at] = (out[at] + self._random.choice((-8, -2, -1, 1, 2, 8))) % 256
