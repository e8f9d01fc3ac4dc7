"""Reads cutter location files in APT (ISO 4343) and writes them back with only their targets replaced."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, Signs, UnitWords

LANGUAGE: Final = Language(
    title="APT cutter location files (ISO 4343)",
    endings=(".apt", ".aptsource", ".cls", ".cl", ".ncl"),
    signs=Signs(
        "an APT or CL file of a CAM system",
        (
            r"^(PARTNO|PPRINT|MACHIN|FEDRAT|CUTTER|LOADTL|SPINDL|COOLNT|MULTAX|TOOL PATH|TLDATA|CUTCOM|UNITS|CATIA0)"
            r"(\s*/|\s|$)",
            r"^(GOTO|RAPID|CIRCLE|GODLTA|FROM)\s*/",
            r"^\$\$",
        ),
        (r"^RAPID$", r"^FINI$", r"^END-OF-PATH$"),
    ),
    comment=re.compile(r"\$\$(.*)"),
    orientation=False,
    read="counterflex.programs.apt.reader:read_apt_file",
    table="counterflex.programs.apt.word_table:TABLE",
    doubts="counterflex.programs.apt.stated:skipped_by_switch",
    units=UnitWords(
        frozenset(), "UNITS/MM, UNITS/INCHES",
        re.compile(r"\s*(?:UNITS?\s*/|(?:MM|INCH|INCHES)\s*$)", re.IGNORECASE),
    ),
    diameters="counterflex.programs.apt.stated:cutter_diameters",
    in_place="counterflex.programs.apt.writer:write_apt",
    convert="counterflex.programs.apt.emitter:convert",
)  # fmt: skip
