"""The recipe's own judgement of readings while they are taken: outliers, and what looks like a mistake."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from counterflex.app.identification.cell_model import model_of
from counterflex.app.identification.identify import prepare
from counterflex.app.studio import texts
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, ModelError

_LINE: Final = re.compile(r":(\d+)(?::|$)")


@dataclass(frozen=True)
class ReadingCheck:
    """What a recipe says of readings."""

    fault: str = ""  # why it does not take them
    at_line: dict[int, str] = field(default_factory=dict)  # by line of the file


def check_readings(recipe: str, manifest: Path, cell: Path) -> ReadingCheck:
    """Identify from the readings there are, write nothing, and return what the recipe says about them."""
    try:
        task = prepare(recipe, [manifest], cell)
        # Predicting the same readings spares the fits of the folds: their error says nothing, and is not shown.
        found = task.recipe.identify(model_of(task.cell), task.data, task.data, task.settings)
    except (FileFormatError, InputError, ModelError) as fault:
        return _refused(fault)
    except ArithmeticError as fault:  # too few readings for the algebra
        return ReadingCheck(fault=str(fault))
    place = task.place_of(found)
    at_line = {}
    for fit in found.fits.values():
        for one in fit.outliers:
            match = _LINE.search(place(one.block, one.row))
            if match is not None:
                at_line[int(match[1])] = texts.ROW_OUTLIER.format(size=one.size)
    return ReadingCheck(at_line=at_line)


def _refused(fault: CounterflexError) -> ReadingCheck:
    match = _LINE.search(str(fault.where or ""))
    return ReadingCheck(str(fault), at_line={} if match is None else {int(match[1]): fault.what})
