"""Drawings of a holder: read strictly, one line for what cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.core.errors import FileFormatError
from counterflex.files.holder_file import holder_data, read_holder
from counterflex.files.schema import write_toml

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "holders" / "bridged.toml"


def test_the_example_is_read_and_written_back(tmp_path: Path) -> None:
    file = read_holder(EXAMPLE)
    drawing = file.drawing(str(EXAMPLE))
    assert len(drawing.pockets) == 6, "each of three in both cheeks"
    assert (drawing.beam.length_m, drawing.gauge_m, file.noise) == (0.18, 0.003, 0.2e-6)
    write_toml(tmp_path / "again.toml", holder_data(file, drawing))
    assert read_holder(tmp_path / "again.toml").drawing("again") == drawing.__class__(
        drawing.beam, drawing.pockets, drawing.p_holder_tcp, drawing.gauge_m
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("rib_mm = 4.0", "rib_m = 0.004", "rib_m"),
        ("depth_mm = 8.0", "depth_mm = 14.5", "wall behind the pocket"),
        ("depth_mm = 8.0", "depth_mm = -8.0", "depth_mm"),
        ("width_mm = 118.0", "width_mm = 50.0", "beyond the cheek across"),
        ('cheek = "both"', 'cheek = "left"', "cheek"),
        ("version = 1", "version = 2", "version"),
        ('format = "counterflex-holder"', 'format = "counterflex-cell"', "counterflex-holder"),
        ("distance_mm = 160.0", "distance_mm = 15.0", "overlap"),
        ("gauge_mm = 3.0", "gauge_mm = 8.0", "shorter along the cheek"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "holder.toml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(FileFormatError, match=said) as told:
        read_holder(file).drawing(str(file))
    assert "\n" not in str(told.value)
