"""Names of the program languages, for the command line, which loads no writer before it knows that it needs one."""

from __future__ import annotations

from typing import Any, Final

from counterflex.core.registry import Registry

LANGUAGES: Final[Registry[Any]] = Registry(
    "counterflex.languages",
    "output language",
    "counterflex.app.compensation.languages:LanguageKind",
    {
        "gcode": "counterflex.app.compensation.languages:GCODE",
        "krl": "counterflex.app.compensation.languages:KRL",
        "rapid": "counterflex.app.compensation.languages:RAPID",
        "fanuc": "counterflex.app.compensation.languages:FANUC",
        "val3": "counterflex.app.compensation.languages:VAL3",
    },
)
