"""Programs come back in the bytes they came in: encoding, byte order mark and line ends."""

from __future__ import annotations

import codecs
from pathlib import Path

import pytest

from counterflex.app.compensation import compensate

HEAD = "(Prüfstück Ø16)\r\nG21 G17 G90\r\nM6 T1\r\nM3 S13000\r\nG0 X-12 Y15 Z42\r\n"
CUT = "G0 Z36\r\nG1 X52 F1500 (schräg)\r\nG0 Z42\r\n"
TAIL = "M5\r\nM2\r\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_bytes_come_back(encoding: str, small: Path, tmp_path: Path) -> None:
    program = tmp_path / "part.ngc"
    for text, cuts in ((HEAD + TAIL, False), (HEAD + CUT + TAIL, True)):
        program.write_bytes(text.encode(encoding))
        compensate.run(program, small, tmp_path / "out", predict=False, report=False)
        found = (tmp_path / "out" / "part.ngc").read_bytes()
        assert (found == program.read_bytes()) is not cuts
        assert found.startswith(codecs.BOM_UTF8) is (encoding == "utf-8-sig")
        assert "(Prüfstück Ø16)\r\n" in found.decode(encoding)
        assert not cuts or "(schräg)" in found.decode(encoding)
