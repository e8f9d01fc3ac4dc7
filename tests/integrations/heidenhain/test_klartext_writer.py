"""Klartext written back: only targets change, and what is written is read back where it was commanded."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, UM
from counterflex.integrations.heidenhain.language.in_place import write_heidenhain
from counterflex.integrations.heidenhain.language.reader import read_heidenhain
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.program import Program
from counterflex.programs.rotary.poses import CommandedWords, RotaryWords, turned_path
from robot_corrections import corrected, gap_to_polyline

EXAMPLES = Path(__file__).parents[3] / "examples" / "programs"
TOLERANCE_M = 5.0 * UM
HEAD = ("BEGIN PGM T MM", "TOOL CALL 1 Z S1000 F400", "L X+0 Y+0 Z+5 R0 FMAX M3", "L Z+0 F600")
ENTRIES = st.lists(
    st.tuples(
        st.sampled_from(["L", "IX", "C", "CR", "CT", "LP", "CP", "RND", "FMAX", "dwell", ";text", "M8", "drill"]),
        st.integers(-20, 20), st.integers(-20, 20),
    ),
    min_size=1, max_size=8,
)  # fmt: skip
DRILL = "CYCL DEF 200 D ~\n Q200=2 ~\n Q201=-3 ~\n Q206=150 ~\n Q202=3 ~\n Q210=0 ~\n Q203=+0 ~\n Q204=5 ~\n Q211=0.1"


def lines_of(entries: list[tuple[str, int, int]]) -> list[str]:
    """A program of the entries that make sense where they stand."""
    lines, x, y, straight = list(HEAD), 0, 0, True
    for word, dx, dy in entries:
        moved = abs(dx) + abs(dy) > 1
        if word == "C" and moved:
            lines += [
                f"CC X{x + 0.5 * dx:+.4f} Y{y + 0.5 * dy:+.4f} ;centre",
                f"C X{x + dx:+d} Y{y + dy:+d} DR- F500 M9",
            ]
        elif word == "CR" and moved:
            lines.append(f"CR X{x + dx:+d} Y{y + dy:+d} R{np.hypot(dx, dy):+.4f} DR+ ;arc")
        elif word == "CT" and moved and straight and dx:
            lines += [f"L X{x + dx:+d} Y{y:+d}", f"CT X{x + dx:+d} Y{y + 10:+d}"]
            x, y, dx, dy = x + dx, y + 10, 0, 0
        elif word == "IX":
            lines.append(f"L IX{dx:+d} IY{dy:+d}")
        elif word == "LP":
            lines += [f"CC X{x:+d} Y{y - 5:+d}", "LP PR+5 PA+0 F300", "LP PA+90"]
            dx = dy = 0
        elif word == "CP":
            lines += [f"CC X{x + 5:+d} Y{y:+d}", "CP IPA+360 IZ-1 DR+", "CP IPA+360 IZ+1 DR+"]
            dx = dy = 0
        elif word == "RND" and abs(dx) > 2 and abs(dy) > 2:
            lines += [f"L X{x + dx:+d} Y{y:+d}", "RND R1 F90", f"L X{x + dx:+d} Y{y + dy:+d} M8"]
        elif word == "FMAX":
            lines.append(f"L X{x + dx:+d} R0 FMAX")
            dy = 0
        elif word == "dwell":
            lines += ["CYCL DEF 9.0 DWELL TIME", "CYCL DEF 9.1 DWELL 0.5"]
            dx = dy = 0
        elif word == "drill":
            lines += [DRILL, f"L X{x + dx:+d} Y{y:+d} R0 FMAX M99", "L Z+0 R0 F200"]
            dy = 0
        elif word in (";text", "M8"):
            lines.append(word)
            dx = dy = 0
        else:
            lines.append(f"L X{x + dx:+d} Y{y + dy:+d} R0 F450")
        if word in ("C", "CR", "RND") and lines[-1].startswith("L X") is False and not moved:
            dx = dy = 0
        x, y, straight = x + dx, y + dy, word in ("L", "IX")
    return [*lines, "L Z+50 R0 FMAX", "M30", "END PGM T MM", ""]


def text_of(entries: list[tuple[str, int, int]], newline: str) -> str:
    return newline.join("\n".join(lines_of(entries)).split("\n"))


def commanded(compensated: CompensatedPath, back: Program) -> float:
    """Largest distance of commanded feed rows from what is read back, m."""
    feed = compensated.path.kind == 1
    made = tool_path(back, step_m=0.2 * MM, chord_m=0.5 * UM).p_part_tcp
    rows = compensated.p_part_command[feed]
    return gap_to_polyline(rows, made) if len(rows) else 0.0


@settings(max_examples=60, deadline=None)
@given(ENTRIES, st.sampled_from(["\n", "\r\n"]), st.booleans())
def test_without_correction_every_byte_stays(entries: list[tuple[str, int, int]], newline: str, numbered: bool) -> None:
    lines = lines_of(entries)
    text = newline.join(f"{k} {line}" if numbered and line and "Q2" not in line else line
                        for k, line in enumerate(lines)).replace("\r\n", "\n").replace("\n", newline)  # fmt: skip
    program = read_heidenhain(text, complete=True)
    assert program.straight
    assert write_heidenhain(program, CompensatedPath.nominal(tool_path(program))).text == text


@settings(max_examples=50, deadline=None)
@given(ENTRIES, st.floats(1.0, 300.0), st.sampled_from(["\n", "\r\n"]))
def test_what_is_written_is_read_back_where_it_was_commanded(
    entries: list[tuple[str, int, int]], size_um: float, newline: str
) -> None:
    program = read_heidenhain(text_of(entries, newline), complete=True)
    compensated = corrected(program, size_um * UM, 5.0)
    written = write_heidenhain(program, compensated, tolerance_m=TOLERANCE_M)
    back = read_heidenhain(written.text, complete=True)
    assert commanded(compensated, back) <= TOLERANCE_M + 4.0 * written.resolution_m + 1.0 * UM
    np.testing.assert_allclose(back.motions[-1].p_end, compensated.p_part_command[-1], atol=0.2 * UM)
    for motion in back.motions:
        assert motion.tool == 1
    feeds = {round(m.feed_m_s * 60e3) for m in program.motions if m.kind in ("feed", "arc")}
    for motion in back.motions:
        if motion.kind in ("feed", "arc"):
            assert min(abs(motion.feed_m_s * 60e3 / feed - 1.0) for feed in feeds) < 1.01


@settings(max_examples=40, deadline=None)
@given(ENTRIES, st.floats(1.0, 200.0))
def test_words_beside_targets_stay(entries: list[tuple[str, int, int]], size_um: float) -> None:
    """Comments, tool calls, cycles and M functions are there in their order; nothing else of the text is lost."""
    text = text_of(entries, "\n")
    program = read_heidenhain(text, complete=True)
    after = write_heidenhain(program, corrected(program, size_um * UM, 3.0), header=False).text
    kept = re.compile(r";.*|TOOL CALL.*|BEGIN.*|END.*|M(?:3|8|9|30)\b")
    assert kept.findall(after) == kept.findall(text)


def test_one_corrected_move_changes_one_line_and_what_inherits_it() -> None:
    text = "\n".join([*HEAD, "L X+10", "L Y+10 ;side", "L X+0 Y+0", "L Z+50 FMAX", "M30", "END PGM T MM", ""])
    program = read_heidenhain(text, complete=True)
    path = tool_path(program)
    share = np.where(path.motion == 2, path.p_part_tcp[:, 0] / (10.0 * MM), 0.0)
    correction = share[:, None] * np.array([0.0, 0.1 * MM, 0.0])
    made = write_heidenhain(program, CompensatedPath.from_correction(path, correction), header=False).text.split("\n")
    before = text.split("\n")
    assert [line for line in made if line not in before] == ["L X+10 Y+0.1000"]
    assert [line for line in before if line not in made] == ["L X+10"]


def test_a_corrected_circle_keeps_its_form() -> None:
    text = "\n".join([*HEAD, "CC X+10 Y+0 ;middle", "C X+20 Y+0 DR- F500", "CR X+30 Y+0 R+5 DR+", "CC X+40 Y+0",
                      "C X+50 Y+0 DR+", "L Z+50 FMAX", "END PGM T MM", ""])  # fmt: skip
    program = read_heidenhain(text, complete=True)
    path = tool_path(program)
    correction = np.tile(np.array([0.05, 0.02, 0.0]) * MM, (len(path), 1))
    written = write_heidenhain(program, CompensatedPath.from_correction(path, correction), header=False)
    lines = written.text.split("\n")
    assert lines[4:7] == ["CC X+10.0500 Y+0.0200 ;middle", "C X+20.0500 Y+0.0200 DR- F500",
                          "CR X+30.0500 Y+0.0200 R+5.0000 DR+"]  # fmt: skip
    assert written.arcs_kept == 3
    back = read_heidenhain(written.text, complete=True)
    np.testing.assert_allclose(np.asarray(back.motions[-2].p_end) / MM, [50.05, 0.02, 0.0], atol=1e-3)


def test_labels_are_written_out_and_mirror_images_refused() -> None:
    text = "\n".join([*HEAD, "Q1 = 5", "LBL 1", "CYCL DEF 7.0 D", "CYCL DEF 7.1 IX+1", "L X+0 Y+Q1", "L Y+0",
                      "CALL LBL 1 REP 2", "L Z+50 FMAX", "END PGM T MM", ""])  # fmt: skip
    program = read_heidenhain(text, complete=True)
    compensated = corrected(program, 100 * UM, 4.0)
    written = write_heidenhain(program, compensated, tolerance_m=TOLERANCE_M)
    assert written.unrolled
    assert "LBL" not in written.text
    back = read_heidenhain(written.text, complete=True)
    assert commanded(compensated, back) <= TOLERANCE_M + 1.5 * UM
    mirrored = read_heidenhain(text.replace("CYCL DEF 7.0 D\nCYCL DEF 7.1 IX+1", "CYCL DEF 8.0 M\nCYCL DEF 8.1 X"))
    with pytest.raises(ProgramError, match="mirror image"):
        write_heidenhain(mirrored, corrected(mirrored, 100 * UM, 4.0))


def test_a_rotated_program_is_written_in_its_own_axes() -> None:
    text = "\n".join([*HEAD, "CYCL DEF 7.0 D", "CYCL DEF 7.1 X+10", "CYCL DEF 10.0 R", "CYCL DEF 10.1 ROT+30",
                      "L X+0 Y+0", "L X+20", "CC X+20 Y+5", "C X+20 Y+10 DR+",
                      "L Z+50 FMAX", "END PGM T MM", ""])  # fmt: skip
    program = read_heidenhain(text, complete=True)
    compensated = corrected(program, 100 * UM, 4.0)
    written = write_heidenhain(program, compensated, tolerance_m=TOLERANCE_M)
    back = read_heidenhain(written.text, complete=True)
    assert commanded(compensated, back) <= TOLERANCE_M + 1.5 * UM


def test_inch_programs_get_one_more_decimal() -> None:
    text = (EXAMPLES / "groove.h").read_text().replace(" MM", " INCH")
    program = read_heidenhain(text, complete=True)
    compensated = corrected(program, 50 * UM, 4.0)
    written = write_heidenhain(program, compensated, tolerance_m=TOLERANCE_M, header=False)
    assert re.search(r"X-11\.\d{5} ", written.text)
    back = read_heidenhain(written.text, complete=True)
    np.testing.assert_allclose(back.motions[-1].p_end, compensated.p_part_command[-1], atol=0.3 * UM)


def test_a_tilted_plane_is_written_in_its_own_axes() -> None:
    """The tool stays at right angles to the plane: what the plan would turn is said to be left out."""
    lines = (
        *HEAD, "L Z+50 FMAX", "CYCL DEF 7.0 D", "CYCL DEF 7.1 X+20", "PLANE SPATIAL SPA+10 SPB-15 SPC+30 TURN",
        "L X+0 Y-12 R0 FMAX", "L Z+20 FMAX", "L Z-6 F300", "L Y+72 ;cut", "CC X+5 Y+72", "C X+10 Y+72 DR-",
        "L Z+20 FMAX", "PLANE RESET TURN FMAX", "END PGM T MM", "",
    )  # fmt: skip
    text = "\n".join(lines)
    program = read_heidenhain(text, complete=True)
    words = RotaryWords.of(program, None)
    turned = turned_path(program, words, step_m=0.5 * MM, rapid_speed_m_s=0.5)
    way = np.linspace(0.0, 1.0, len(turned.path))[:, None]
    shift = 0.1 * MM * np.sin(3.0 * way) * np.array([0.3, 1.0, 0.6])
    made = CommandedWords.of(turned, words, shift, 1e-3 * way * np.array([1.0, 0.0, 0.0]))
    nominal = CompensatedPath.nominal(turned.path)
    written = write_heidenhain(program, nominal, tolerance_m=TOLERANCE_M, words=made)
    assert written.largest_dropped_rotation_rad == pytest.approx(1e-3, rel=0.2)
    back = read_heidenhain(written.text, complete=True)
    line = turned_path(back, RotaryWords.of(back, None), step_m=0.2 * MM, rapid_speed_m_s=0.5).path.p_part_tcp
    rows = made.p_command[turned.path.kind == 1]
    assert gap_to_polyline(rows, line) <= TOLERANCE_M + 1.5 * UM
    assert "PLANE SPATIAL SPA+10 SPB-15 SPC+30 TURN" in written.text


def test_tool_vectors_and_rotary_words_are_written_with_their_axis() -> None:
    text = "\n".join([*HEAD, "M128", "LN X+0 Y+0 Z+5 TX+0 TY+0 TZ+1 R0 F500",
                      "LN X+10 Y+0 Z+5 TX+0.1 TY+0 TZ+0.9949874",
                      "M129", "END PGM T MM", ""])  # fmt: skip
    program = read_heidenhain(text, complete=True)
    words = RotaryWords.of(program, None)
    turned = turned_path(program, words, step_m=0.5 * MM, rapid_speed_m_s=0.5)
    turn = np.tile([0.0, 2e-4, 0.0], (len(turned.path), 1))
    made = CommandedWords.of(turned, words, np.full((len(turned.path), 3), 0.05 * MM), turn)
    written = write_heidenhain(program, CompensatedPath.nominal(turned.path), tolerance_m=TOLERANCE_M, words=made)
    back = read_heidenhain(written.text, complete=True)
    np.testing.assert_allclose(back.motions[-1].abc_end, made.angle_command_rad[-1], atol=1e-7)
    np.testing.assert_allclose(back.motions[-1].p_end, made.p_command[-1], atol=0.1 * UM)
