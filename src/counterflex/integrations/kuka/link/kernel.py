"""Scanner and writer of RSI telegrams, compiled. A closed subset of XML, exactly what a robot controller sends.

``<Rob ...><Name a="1" b="2"/><Name>3</Name>...</Rob>``: one level of elements, attributes in double or single quotes,
text without markup. No declaration, comment, entity, CDATA or nesting: those make the telegram invalid.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.protocols.decimal_kernel import Bytes, read_decimal, read_integer, write_decimal, write_integer

OK: Final = 0
NOT_A_TELEGRAM: Final = 1
TRUNCATED: Final = 2
MALFORMED: Final = 3
BAD_NUMBER: Final = 4
REPEATED: Final = 5
MISSING: Final = 6
NO_IPOC: Final = 7

NUMBER: Final = 0
TEXT: Final = 1


@kernel("boolean(uint8)", inline=True)
def _blank(c: int) -> bool:
    return c == 32 or c == 9 or c == 10 or c == 13


@kernel("boolean(uint8)", inline=True)
def _name(c: int) -> bool:
    return (65 <= c <= 90) or (97 <= c <= 122) or (48 <= c <= 57) or c == 95 or c == 45 or c == 46


@kernel("boolean(uint8)", inline=True)
def _begins_name(c: int) -> bool:
    return (65 <= c <= 90) or (97 <= c <= 122) or c == 95


@kernel("boolean(uint8[::1], int64, int64, uint8[::1], int64, int64)")
def _same(data: Bytes, begin: int, end: int, names: Bytes, first: int, last: int) -> bool:
    if end - begin != last - first:
        return False
    same = True
    for i in range(end - begin):
        same &= data[begin + i] == names[first + i]
    return same


@kernel("int64(uint8[::1], int64, int64, int64, int64, uint8[::1], int64[:, ::1], int64)")
def _find(data: Bytes, b: int, e: int, ab: int, ae: int, names: Bytes, entries: Int, hint: int) -> int:
    """Entry of element ``data[b:e]`` and attribute ``data[ab:ae]`` (empty: its text), tried at ``hint`` first."""
    n = entries.shape[0]
    for k in range(n):
        j = hint + k
        if j >= n:
            j -= n
        if _same(data, b, e, names, entries[j, 0], entries[j, 1]) and _same(
            data, ab, ae, names, entries[j, 2], entries[j, 3]
        ):
            return j
    return -1


@kernel("boolean(uint8[::1], int64, int64, int64)")
def _named_before(data: Bytes, begin: int, b: int, e: int) -> bool:
    """Return whether the attribute ``data[b:e]`` has a namesake among those, well-formed, of ``data[begin:b]``."""
    i = begin
    while i < b:
        while i < b and _blank(data[i]):
            i += 1
        first = i
        while i < b and _name(data[i]):
            i += 1
        if i >= b:
            return False
        if _same(data, b, e, data, first, i):
            return True
        quote = data[i + 1]
        i += 2
        while data[i] != quote:
            i += 1
        i += 1
    return False


@kernel(
    "Tuple((int64, int64, int64))"
    "(uint8[::1], int64, uint8[::1], uint8[::1], int64[:, ::1], float64[::1], boolean[::1])",
    entry=True,
)
def scan(
    data: Bytes, length: int, root: Bytes, names: Bytes, entries: Int, values: Float, seen: Bool
) -> tuple[int, int, int]:
    """Read one telegram.

    Args:
        data: Buffer that holds it.
        root: Name of the root element (``Rob`` or ``Sen``).
        names: All names of the layout, one behind the other.
        entries: (m, 5) per value: begin and end of its element's name, of its attribute's name (equal: the element's
            text), and NUMBER or TEXT. The counter IPOC is not among them.
        values: (m,) numbers read; those not seen are left as they were.
        seen: (m,) set where the telegram held the value.

    Returns:
        Status, the counter IPOC (-1 where there is none), and the byte at which the scan ended. An element or
        attribute that the layout does not know is passed over. Status MISSING: well-formed, but not every value was
        there; ``seen`` says which.
    """
    for k in range(seen.shape[0]):
        seen[k] = False
    counter = -1
    while length > 0 and (_blank(data[length - 1]) or data[length - 1] == 0):
        length -= 1
    for k in range(length):
        if data[k] > 126 or (data[k] < 32 and not _blank(data[k])):
            return (NOT_A_TELEGRAM if data[0] != 60 else MALFORMED), counter, k
    i = 0
    while i < length and _blank(data[i]):
        i += 1
    size = root.shape[0]
    if i + size + 1 > length or data[i] != 60 or not _same(data, i + 1, i + 1 + size, root, 0, size):
        return NOT_A_TELEGRAM, counter, i
    i += 1 + size
    head = i
    while True:  # attributes of the root are of no concern
        while i < length and _blank(data[i]):
            i += 1
        if i >= length:
            return TRUNCATED, counter, i
        if data[i] == 62:
            i += 1
            break
        if not _blank(data[i - 1]):
            return NOT_A_TELEGRAM, counter, i
        if not _begins_name(data[i]):
            return MALFORMED, counter, i
        ab = i
        while i < length and _name(data[i]):
            i += 1
        if i >= length:
            return TRUNCATED, counter, i
        if data[i] != 61 or _named_before(data, head, ab, i):
            return MALFORMED, counter, i
        i += 1
        if i >= length:
            return TRUNCATED, counter, i
        quote = data[i]
        if quote != 34 and quote != 39:
            return MALFORMED, counter, i
        i += 1
        while i < length and data[i] != quote and data[i] != 60 and data[i] != 38:
            i += 1
        if i >= length:
            return TRUNCATED, counter, i
        if data[i] != quote:
            return MALFORMED, counter, i
        i += 1
    hint = 0
    while True:
        while i < length and _blank(data[i]):
            i += 1
        if i + 1 >= length:
            return TRUNCATED, counter, i
        if data[i] != 60:
            return MALFORMED, counter, i
        if data[i + 1] == 47:
            if i + 2 + size >= length:
                return TRUNCATED, counter, i
            if not _same(data, i + 2, i + 2 + size, root, 0, size) or data[i + 2 + size] != 62:
                return MALFORMED, counter, i
            i += 3 + size
            break
        i += 1
        b = i
        while i < length and _name(data[i]):
            i += 1
        e = i
        if e == b or not _begins_name(data[b]):
            return MALFORMED, counter, i
        closed = False
        while True:
            gap = i
            while i < length and _blank(data[i]):
                i += 1
            if i >= length:
                return TRUNCATED, counter, i
            if data[i] == 62:
                i += 1
                break
            if data[i] == 47:
                if i + 1 >= length:
                    return TRUNCATED, counter, i
                if data[i + 1] != 62:
                    return MALFORMED, counter, i
                closed = True
                i += 2
                break
            if gap == i:
                return MALFORMED, counter, i
            ab = i
            while i < length and _name(data[i]):
                i += 1
            ae = i
            if ae == ab or not _begins_name(data[ab]):
                return MALFORMED, counter, i
            if i + 1 >= length:
                return TRUNCATED, counter, i
            if data[i] != 61 or (data[i + 1] != 34 and data[i + 1] != 39):
                return MALFORMED, counter, i
            quote = data[i + 1]
            i += 2
            vb = i
            while i < length and data[i] != quote and data[i] != 60 and data[i] != 38:
                i += 1
            if i >= length:
                return TRUNCATED, counter, i
            if data[i] != quote:
                return MALFORMED, counter, i
            j = _find(data, b, e, ab, ae, names, entries, hint)
            if j < 0 and _named_before(data, e, ab, ae):
                return REPEATED, counter, vb
            if j >= 0:
                hint = j + 1 if j + 1 < entries.shape[0] else 0
                if seen[j]:
                    return REPEATED, counter, vb
                if entries[j, 4] == NUMBER:
                    number, good = read_decimal(data, vb, i)
                    if good == 0:
                        return BAD_NUMBER, counter, vb
                    values[j] = number
                seen[j] = True
            i += 1
        if closed:
            continue
        vb = i
        while i < length and data[i] != 60 and data[i] != 38:
            if data[i] == 62 and i >= vb + 2 and data[i - 1] == 93 and data[i - 2] == 93:
                return MALFORMED, counter, i  # ]]> is none in a text
            i += 1
        if i >= length:
            return TRUNCATED, counter, i
        ve = i
        if data[i] == 38 or i + 2 + (e - b) >= length:
            return (MALFORMED if data[i] == 38 else TRUNCATED), counter, i
        if data[i + 1] != 47 or not _same(data, i + 2, i + 2 + (e - b), data, b, e) or data[i + 2 + (e - b)] != 62:
            return MALFORMED, counter, i
        i += 3 + (e - b)
        while vb < ve and _blank(data[vb]):
            vb += 1
        while ve > vb and _blank(data[ve - 1]):
            ve -= 1
        if e - b == 4 and data[b] == 73 and data[b + 1] == 80 and data[b + 2] == 79 and data[b + 3] == 67:
            if counter >= 0:
                return REPEATED, counter, vb
            whole, good = read_integer(data, vb, ve)
            if good == 0:
                return BAD_NUMBER, counter, vb
            counter = whole
            continue
        j = _find(data, b, e, 0, 0, names, entries, hint)
        if j >= 0:
            hint = j + 1 if j + 1 < entries.shape[0] else 0
            if seen[j]:
                return REPEATED, counter, vb
            if entries[j, 4] == NUMBER:
                number, good = read_decimal(data, vb, ve)
                if good == 0:
                    return BAD_NUMBER, counter, vb
                values[j] = number
            seen[j] = True
    if i != length:
        return MALFORMED, counter, i
    if counter < 0:
        return NO_IPOC, counter, i
    for k in range(seen.shape[0]):
        if not seen[k]:
            return MISSING, counter, i
    return OK, counter, i


@kernel("int64(uint8[::1], uint8[::1], int64[:, ::1], float64[::1], int64)", entry=True)
def compose(out: Bytes, pieces: Bytes, parts: Int, values: Float, counter: int) -> int:
    """Write one telegram.

    Args:
        out: Buffer.
        pieces: All fixed text, one behind the other.
        parts: (m, 4) in order: begin and end of the fixed text that comes first, the value behind it (-1: none, -2:
            the counter IPOC), and its decimal places.
        values: Numbers; all finite.
        counter: IPOC.

    Returns:
        Length of the telegram; 0 where a number cannot be written or the buffer is too short: nothing may be sent.
    """
    at = 0
    for k in range(parts.shape[0]):
        b, e = parts[k, 0], parts[k, 1]
        if at + (e - b) > out.shape[0]:
            return 0
        for i in range(b, e):
            out[at] = pieces[i]
            at += 1
        which = parts[k, 2]
        if which == -2:
            at = write_integer(out, at, counter)
        elif which >= 0:
            at = write_decimal(out, at, values[which], parts[k, 3])
        if at < 0:
            return 0
    return at
