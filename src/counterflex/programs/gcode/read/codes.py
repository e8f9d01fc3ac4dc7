"""Which G and M codes the reader knows, their modal groups, and why it refuses the others.

Codes are kept as tenths: G43.1 is 431. Source: LinuxCNC, G-codes, M-codes and "Modal groups".
"""

from __future__ import annotations

from typing import Final

G_GROUP: Final[dict[int, str]] = {
    **dict.fromkeys((40, 100, 280, 281, 300, 301, 520, 530, 920, 921, 922, 923), "non-modal"),
    **dict.fromkeys((0, 10, 20, 30, 730, 800, 810, 820, 830, 850, 860, 890), "motion"),
    **dict.fromkeys((170, 180, 190), "plane"),
    **dict.fromkeys((900, 910), "distance"),
    **dict.fromkeys((901, 911), "arc distance"),
    **dict.fromkeys((930, 940, 950), "feed"),
    **dict.fromkeys((200, 210), "units"),
    400: "cutter radius",
    **dict.fromkeys((430, 431, 434, 435, 490), "tool length"),
    **dict.fromkeys((980, 990), "retract"),
    **dict.fromkeys((540, 550, 560, 570, 580, 590, 591, 592, 593), "work offset"),
    **dict.fromkeys((610, 611, 640), "path control"),
    80: "diameter",
    **dict.fromkeys((960, 970), "spindle mode"),
}

_CAM: Final = "Let the CAM system write the tool-centre path"
_CYCLE: Final = "Use G81, G82, G83, G85, G86 or G89, or let the CAM system write the moves"
REFUSED_G: Final[dict[int, tuple[str, str]]] = {
    410: ("cutter radius compensation G41 depends on the machine's tool table", _CAM),
    411: ("cutter radius compensation G41.1 is not read", _CAM),
    420: ("cutter radius compensation G42 depends on the machine's tool table", _CAM),
    421: ("cutter radius compensation G42.1 is not read", _CAM),
    432: ("additional tool offsets G43.2 are not read", "Use G43 or G43.1"),
    50: ("splines G5 are not read", _CAM),
    51: ("splines G5.1 are not read", _CAM),
    52: ("splines G5.2 are not read", _CAM),
    53: ("splines G5.3 are not read", _CAM),
    70: ("lathe diameter mode G7 is not milling", "Use radii"),
    171: ("the UV plane G17.1 is not read", "Use G17, G18 or G19"),
    181: ("the WU plane G18.1 is not read", "Use G17, G18 or G19"),
    191: ("the VW plane G19.1 is not read", "Use G17, G18 or G19"),
    330: ("spindle-synchronised motion G33 is not milling", _CYCLE),
    331: ("rigid tapping G33.1 is not milling", _CYCLE),
    382: ("probing G38.2 has no known end point", "Take probing out of the program"),
    383: ("probing G38.3 has no known end point", "Take probing out of the program"),
    384: ("probing G38.4 has no known end point", "Take probing out of the program"),
    385: ("probing G38.5 has no known end point", "Take probing out of the program"),
    740: ("tapping G74 is not milling", _CYCLE),
    760: ("threading cycle G76 is not milling", _CYCLE),
    840: ("tapping G84 is not milling", _CYCLE),
    870: ("back boring G87 is not read", _CYCLE),
    880: ("boring with manual retract G88 is not read", _CYCLE),
}

M_GROUP: Final[dict[int, str]] = {
    **dict.fromkeys((0, 10, 20, 300, 600, 980, 990), "stopping"),
    **dict.fromkeys((30, 40, 50, 190), "spindle"),
    60: "tool change",
    610: "tool change",
    **dict.fromkeys((70, 80, 90), "coolant"),
    **dict.fromkeys((480, 490, 500, 510, 520, 530), "override"),
    **dict.fromkeys((620, 630, 640, 650, 670, 680), "output"),
}
REFUSED_M: Final[dict[int, tuple[str, str]]] = {
    660: ("M66 waits for an input that is not known here", "Take it out of the program"),
    700: ("M70 saves a modal state and is not read", "Set the modes with their own codes"),
    710: ("M71 drops a modal state and is not read", "Set the modes with their own codes"),
    720: ("M72 restores a modal state and is not read", "Set the modes with their own codes"),
    730: ("M73 saves a modal state and is not read", "Set the modes with their own codes"),
}

WORDS_OF_M: Final[dict[int, str]] = {
    19: "RPQ",
    **dict.fromkeys((48, 49, 50, 51, 52, 53, 62, 63, 64, 65), "P"),
    61: "Q",
    **dict.fromkeys((67, 68), "EQ"),
    98: "PL",
}
"""Words that an M-code takes, by its number."""
AXES: Final = "XYZABC"
CYCLES: Final = frozenset((730, 810, 820, 830, 850, 860, 890))
TAKES_AXES: Final = frozenset((100, 280, 300, 520, 920))


def code_name(letter: str, code: int) -> str:
    """Return the usual spelling of a code kept as tenths, ``G43.1`` or ``M3``."""
    whole, tenth = divmod(code, 10)
    return f"{letter}{whole}.{tenth}" if tenth else f"{letter}{whole}"
