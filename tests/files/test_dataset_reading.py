"""Laboratories' files are read as they are, and every fault names file, line, column and what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from counterflex.core.errors import FileFormatError
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.dataset.units import UNITS, factor, plain
from counterflex.identify.data.channels import CHANNELS
from counterflex.identify.data.dataset import Dataset

HEAD = 'format = "counterflex-dataset"\nversion = 1\nname = "lab"\nkind = "pulls"\n'
PULL = '[channels.f_tcp_base]\ncolumns = ["Fx", "Fy", "Fz"]\nunit = "N"\nsigma = 2.0\n'
FILE = '[[files]]\npath = "a.csv"\n'


def lab(folder: Path, manifest: str, **files: str | bytes) -> Path:
    for name, content in files.items():
        data = content.encode() if isinstance(content, str) else content
        (folder / name.replace("_csv", ".csv")).write_bytes(data)
    path = folder / "lab.toml"
    path.write_text(HEAD + manifest, encoding="utf-8")
    return path


def fault(folder: Path, manifest: str, **files: str | bytes) -> str:
    with pytest.raises(FileFormatError) as found:
        read_dataset(lab(folder, manifest, **files))
    line = str(found.value)
    assert "\n" not in line
    return line


def forces(folder: Path, how: str, content: str | bytes) -> Dataset:
    return read_dataset(lab(folder, f"{FILE}{how}\n{PULL}", a_csv=content))


def refused(folder: Path, how: str, content: str | bytes) -> str:
    return fault(folder, f"{FILE}{how}\n{PULL}", a_csv=content)


def test_decimal_comma_semicolon_crlf_and_trailing_cells(tmp_path: Path) -> None:
    text = "Timestamp;Fx;Fy;Fz;;\r\n2,02011E+13;1,5;-2,78E-05;3;;\r\n2,02011E+13;+4;,5;6,;;\r\n;;;;;\r\n\r\n"
    data = forces(tmp_path, 'separator = ";"\ndecimal = ","', text)
    np.testing.assert_array_equal(data.values("f_tcp_base"), [[1.5, -2.78e-5, 3.0], [4.0, 0.5, 6.0]])
    assert data.line.tolist() == [2, 3]
    assert data.place(1).endswith("a.csv:3")


def test_thousands_marks_group_three_digits_or_are_refused(tmp_path: Path) -> None:
    how = 'separator = ";"\ndecimal = ","\nthousands = "."'
    data = forces(tmp_path, how, "Fx;Fy;Fz\n-12.345;12.345,25;999,25\n")
    np.testing.assert_array_equal(data.values("f_tcp_base"), [[-12345.0, 12345.25, 999.25]])
    line = refused(tmp_path, how, "Fx;Fy;Fz\n1,5;2,5;3,5\n1.2345;2;3\n")
    assert "a.csv:3: column 'Fx'" in line
    assert "'1.2345'" in line


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_byte_order_marks_and_encodings(tmp_path: Path, encoding: str) -> None:
    text = "Fx,Fy,Fz,Prüfer\n1,2,3,Jäger\n"
    how = 'encoding = "cp1252"' if encoding == "cp1252" else ""
    np.testing.assert_array_equal(forces(tmp_path, how, text.encode(encoding)).values("f_tcp_base"), [[1, 2, 3]])
    if encoding == "cp1252":
        line = refused(tmp_path, "", text.encode(encoding))
        assert "a.csv:1" in line
        assert 'encoding = "cp1252"' in line


def test_header_below_remarks_unit_row_comments_and_old_line_ends(tmp_path: Path) -> None:
    text = "Messung 7\r\rFx,Fy,Fz\rN,N,N\r# warm\r1,2,3\r4,5,6\r"
    data = forces(tmp_path, 'header_line = 3\nskip_lines = [4]\ncomment = "#"', text)
    np.testing.assert_array_equal(data.values("f_tcp_base"), [[1, 2, 3], [4, 5, 6]])
    assert data.line.tolist() == [6, 7]


def test_columns_by_number_without_header_and_spaces_between(tmp_path: Path) -> None:
    pull = PULL.replace('["Fx", "Fy", "Fz"]', "[2, 3, 4]")
    manifest = f'{FILE}separator = "space"\nheader_line = 0\n{pull}'
    data = read_dataset(lab(tmp_path, manifest, a_csv="1   2.0  3.0 4.0\n2 5 6  7\n"))
    np.testing.assert_array_equal(data.values("f_tcp_base"), [[2, 3, 4], [5, 6, 7]])


def test_quoted_line_breaks_keep_the_line_numbers_of_the_file(tmp_path: Path) -> None:
    text = 'Remark,Fx,Fy,Fz\n"two\nlines",1,2,3\nplain,4,5,x\n'
    assert "a.csv:4: column 'Fz'" in refused(tmp_path, "", text)


@pytest.mark.parametrize(
    ("cell", "wanted"),
    [
        ("", "is empty or not a number (1 such row)"),
        ("NaN", "is empty or not a number"),
        ("#N/A", "is empty or not a number"),
        ("inf", "not a number"),
        ("1e999", "not a number"),
        ("1_000", "not a number"),
        ("0x10", "not a number"),
        ("5 N", "Units belong into the manifest"),
        ("1'234.5", 'thousands = "\'"'),
        ("fx", "not a number"),
        ("1e9", "too large for its unit"),
    ],
)
def test_bad_cells_are_named(tmp_path: Path, cell: str, wanted: str) -> None:
    line = refused(tmp_path, "", f"Fx,Fy,Fz\n1,2,3\n4,{cell},6\n")
    assert "a.csv:3: column 'Fy'" in line
    assert wanted in line


def test_decimal_comma_in_a_file_that_was_not_declared_to_have_one(tmp_path: Path) -> None:
    line = refused(tmp_path, 'separator = ";"', "Fx;Fy;Fz\n1,5;2;3\n")
    assert 'decimal = ","' in line
    line = refused(tmp_path, 'separator = ";"\ndecimal = ","', "Fx;Fy;Fz\n1.5;2;3\n")
    assert 'decimal = "."' in line
    assert "more cells than the header" in refused(tmp_path, "", "Fx,Fy,Fz\n1,5,2,5,3,5\n")


def test_incomplete_rows_are_dropped_when_asked(tmp_path: Path) -> None:
    manifest = f"{FILE}[rows]\ndrop_incomplete = true\n{PULL}"
    data = read_dataset(lab(tmp_path, manifest, a_csv="Fx,Fy,Fz,r\n1,2,3,\n4,,6,\n7,8,#N/A,\n7,8,9,\n"))
    assert data.line.tolist() == [2, 5]
    assert "no row is complete" in fault(tmp_path, manifest, a_csv="Fx,Fy,Fz\n1,,3\n")


def test_missing_marks_and_rows_by_line(tmp_path: Path) -> None:
    manifest = f'{FILE}missing = ["9999"]\n[rows]\nfirst_line = 3\nlast_line = 7\nevery = 2\n{PULL}'
    text = "Fx,Fy,Fz\n" + "".join(f"{i},0,0\n" for i in range(8))
    assert read_dataset(lab(tmp_path, manifest, a_csv=text)).values("f_tcp_base")[:, 0].tolist() == [1.0, 3.0, 5.0]
    assert "a.csv:5: column 'Fx'" in fault(tmp_path, manifest, a_csv=text.replace("3,0,0", "9999,0,0"))
    assert "no row is taken" in fault(tmp_path, manifest.replace("first_line = 3", "first_line = 30"), a_csv=text)


def test_columns_that_are_not_there_or_twice(tmp_path: Path) -> None:
    assert "Did you mean 'Fx'" in fault(tmp_path, FILE + PULL.replace('"Fx"', '"fx"'), a_csv="Fx,Fy,Fz\n1,2,3\n")
    line = refused(tmp_path, "", "Fx,Fy,Fz,Fx\n1,2,3,4\n")
    assert "1 or 4" in line
    assert 'separator = ";"' in refused(tmp_path, "", "Fx;Fy;Fz\n1;2;3\n")
    assert "has 2 columns" in fault(tmp_path, FILE + PULL.replace(', "Fz"', ""), a_csv="Fx,Fy,Fz\n1,2,3\n")


def test_units_in_headers_are_checked_taken_or_ignored(tmp_path: Path) -> None:
    text = "Fx [kN],Fy [kN],Fz [kN]\n1,2,3\n"
    named = PULL.replace('"Fx", "Fy", "Fz"', '"Fx [kN]", "Fy [kN]", "Fz [kN]"')
    assert "'kN' as in 'Fx [kN]'" in fault(tmp_path, FILE + named, a_csv=text)
    taken = named.replace('unit = "N"\n', "")
    data = read_dataset(lab(tmp_path, FILE + taken, a_csv=text))
    np.testing.assert_array_equal(data.values("f_tcp_base"), [[1000, 2000, 3000]])
    np.testing.assert_array_equal(data.channel("f_tcp_base").sigma, [[2000, 2000, 2000]])
    ignored = read_dataset(lab(tmp_path, f'{FILE}header_units = "ignore"\n{named}', a_csv=text))
    np.testing.assert_array_equal(ignored.values("f_tcp_base"), [[1, 2, 3]])
    assert 'Say unit = "N"' in fault(tmp_path, FILE + PULL.replace('unit = "N"\n', ""), a_csv="Fx,Fy,Fz\n1,2,3\n")
    assert "not one of this quantity" in fault(tmp_path, FILE + PULL.replace('"N"', '"mm"'), a_csv="Fx,Fy,Fz\n1,2,3\n")


QUANTITIES = {
    kind.si_units(kind.allowed[0])[0]: (name, kind.allowed[0])
    for name, kind in CHANNELS.items()
    if kind.nature != "rotation" and len(set(kind.si_units(kind.allowed[0]))) == 1
}
"""A channel of each quantity, with its number of columns."""


@pytest.mark.parametrize("raw", ["[counts]", "(Counts)", "[cnt]", "[digits]", "[LSB]", "[V]", "[mV/V]", "[mA]"])
@pytest.mark.parametrize("si", sorted(QUANTITIES))
def test_numbers_of_a_converter_need_a_factor_in_every_quantity(si: str, raw: str, tmp_path: Path) -> None:
    name, count = QUANTITIES[si]
    shop = CHANNELS[name].file_units(count)[0]
    heads = [f"c{k} {raw}" for k in range(count)]
    text = ",".join(heads) + "\n" + ",".join("3" * count) + "\n"
    manifest = f"{FILE}[channels.{name}]\ncolumns = {heads}\n".replace("'", '"')
    own = plain(raw[1:-1])
    if own in UNITS.get(si, {}):  # a bridge of strain gauges is in V/V
        data = read_dataset(lab(tmp_path, f'{manifest}unit = "{own}"\n', a_csv=text))
        np.testing.assert_allclose(data.values(name), 3.0 * factor(own, si, "") * np.ones((1, count)), rtol=1e-15)
        return
    line = fault(tmp_path, f'{manifest}unit = "{shop}"\n', a_csv=text)
    assert f"'c0 {raw}'" in line
    assert "factor = ..." in line
    if not CHANNELS[name].whole:
        assert "factor = ..." in fault(tmp_path, manifest, a_csv=text)
    data = read_dataset(lab(tmp_path, f'{manifest}unit = "{shop}"\nfactor = 2.0\n', a_csv=text))
    np.testing.assert_allclose(data.values(name), 6.0 * factor(shop, si, "") * np.ones((1, count)), rtol=1e-15)


def test_a_header_in_the_unit_of_another_quantity_is_refused(tmp_path: Path) -> None:
    heads = [f"{c} [mm]" for c in "abc"]
    named = PULL.replace('["Fx", "Fy", "Fz"]', str(heads).replace("'", '"'))
    line = fault(tmp_path, FILE + named, a_csv="a [mm],b [mm],c [mm]\n1,2,3\n")
    assert "'mm' as in 'a [mm]'" in line
    ignored = f'{FILE}header_units = "ignore"\n{named}'
    assert read_dataset(lab(tmp_path, ignored, a_csv="a [mm],b [mm],c [mm]\n1,2,3\n")).values("f_tcp_base")[0, 0] == 1.0
    numbered = PULL.replace('["Fx", "Fy", "Fz"]', '["F (1)", "F (2)", "F_rad"]')
    data = read_dataset(lab(tmp_path, FILE + numbered, a_csv="F (1),F (2),F_rad\n1,2,3\n"))
    assert data.values("f_tcp_base").tolist() == [[1.0, 2.0, 3.0]]


def test_strains_are_in_the_unit_of_their_header(tmp_path: Path) -> None:
    heads = [f"s{k} [um/m]" for k in range(3)]
    manifest = f"{FILE}[channels.strain]\ncolumns = {heads}\n".replace("'", '"')
    data = read_dataset(lab(tmp_path, manifest, a_csv=",".join(heads) + "\n1,2,3\n"))
    np.testing.assert_allclose(data.values("strain"), [[1e-6, 2e-6, 3e-6]], rtol=1e-12)


def test_the_header_of_a_column_of_standard_deviations_is_held_against_its_unit(tmp_path: Path) -> None:
    wide = PULL.replace("sigma = 2.0", 'sigma_columns = ["u [kN]", "v [kN]", "w [kN]"]')
    text = "Fx,Fy,Fz,u [kN],v [kN],w [kN]\n1,2,3,4,1,8\n"
    assert "'kN' as in 'u [kN]'" in fault(tmp_path, FILE + wide, a_csv=text)
    data = read_dataset(lab(tmp_path, f'{FILE}{wide}sigma_unit = "kN"\n', a_csv=text))
    np.testing.assert_allclose(data.channel("f_tcp_base").need_sigma(), [[4e3, 1e3, 8e3]])


def test_a_channel_without_standard_deviation_says_which_line_is_missing(tmp_path: Path) -> None:
    data = read_dataset(lab(tmp_path, FILE + PULL.replace("sigma = 2.0\n", ""), a_csv="Fx,Fy,Fz\n1,2,3\n"))
    with pytest.raises(FileFormatError, match=r"\[channels\.f_tcp_base\]: sigma ="):
        data.channel("f_tcp_base").need_sigma()


def test_standard_deviation_from_repeats_is_pooled_within_groups(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    rows = [(g, *(100.0 * g + rng.normal(0.0, s) for s in (1.0, 2.0, 3.0))) for g in range(200) for _ in range(3)]
    text = "pull,Fx,Fy,Fz\n" + "".join(f"{g},{x!r},{y!r},{z!r}\n" for g, x, y, z in rows)
    repeats = PULL.replace("sigma = 2.0", 'sigma = "repeats"')
    channel = read_dataset(lab(tmp_path, f'group = "pull"\n{FILE}{repeats}', a_csv=text)).channel("f_tcp_base")
    assert "400 degrees of freedom" in channel.source
    assert channel.sigma is not None
    # Three standard errors of a standard deviation with 400 degrees of freedom: 3 / sqrt(800).
    np.testing.assert_allclose(channel.sigma[0], [1.0, 2.0, 3.0], rtol=0.106)
    assert 'group = ["..."]' in fault(tmp_path, FILE + repeats, a_csv=text)
    copied = "pull,Fx,Fy,Fz\n1,1,2,3\n1,1,2,3\n"
    assert "identical" in fault(tmp_path, f'group = "pull"\n{FILE}{repeats}', a_csv=copied)


def test_columns_of_standard_deviations_add_to_the_stated_one(tmp_path: Path) -> None:
    both = PULL.replace("sigma = 2.0", 'sigma = 3.0\nsigma_columns = ["sx", "sy", "sz"]')
    data = read_dataset(lab(tmp_path, FILE + both, a_csv="Fx,Fy,Fz,sx,sy,sz\n1,2,3,4,0,4\n"))
    np.testing.assert_array_equal(data.channel("f_tcp_base").sigma, [[5.0, 3.0, 5.0]])
    only = both.replace("sigma = 3.0\n", "")
    line = fault(tmp_path, FILE + only, a_csv="Fx,Fy,Fz,sx,sy,sz\n1,2,3,4,0,4\n")
    assert "a.csv:2: column 'sy'" in line
    assert "not above zero" in line


def test_columns_of_expanded_uncertainties_are_brought_to_one_standard_deviation(tmp_path: Path) -> None:
    wide = PULL.replace("sigma = 2.0", 'sigma_columns = ["u", "v", "w"]\nsigma_coverage = 2')
    data = read_dataset(lab(tmp_path, FILE + wide, a_csv="Fx,Fy,Fz,u,v,w\n1,2,3,4,1,8\n"))
    np.testing.assert_array_equal(data.channel("f_tcp_base").sigma, [[2.0, 0.5, 4.0]])
    assert "sigma_coverage" in fault(tmp_path, FILE + wide.replace("= 2", "= 0"), a_csv="Fx,Fy,Fz,u,v,w\n1,2,3,4,1,8\n")


@pytest.mark.parametrize("first", [b"PK\x03\x04rest", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1rest"])
def test_a_workbook_is_said_to_be_one(first: bytes, tmp_path: Path) -> None:
    manifest = lab(tmp_path, FILE + PULL, a_csv="Fx,Fy,Fz\n1,2,3\n")
    (tmp_path / "a.csv").write_bytes(first)
    with pytest.raises(FileFormatError, match=r"a spreadsheet workbook is not read.*Save the sheet as CSV"):
        read_dataset(manifest)


def test_several_files_side_by_side_by_row_and_by_key(tmp_path: Path) -> None:
    files = '[[files]]\npath = "a.csv"\n[[files]]\npath = "b.csv"\n'
    moved = '[channels.d_tcp_base]\ncolumns = ["dx", "dy", "dz"]\nunit = "m"\nsigma = 1e-5\n'
    a, b = "n,Fx,Fy,Fz\nP1,1,2,3\nP2,4,5,6\n", "n,dx,dy,dz\nP2,2e-3,0,0\nP1,1e-3,0,0\n"
    by_row = read_dataset(lab(tmp_path, files + PULL + moved, a_csv=a, b_csv=b))
    assert by_row.values("d_tcp_base")[:, 0].tolist() == [2e-3, 1e-3]
    by_key = read_dataset(lab(tmp_path, f'join = "n"\n{files}{PULL}{moved}', a_csv=a, b_csv=b))
    assert by_key.values("d_tcp_base")[:, 0].tolist() == [1e-3, 2e-3]
    assert "2 in a.csv, 1 in b.csv" in fault(tmp_path, files + PULL + moved, a_csv=a, b_csv=b[:-13])
    keyed = f'join = "n"\n{files}{PULL}{moved}'
    assert "a.csv:2" in fault(tmp_path, keyed, a_csv=a, b_csv=b.replace("P1", "P3"))
    assert "b.csv:3" in fault(tmp_path, keyed, a_csv=a, b_csv=b.replace("P1", "P2"))
    both = PULL.replace('"Fx"', '"n"')
    assert "two files have a column" in fault(tmp_path, files + both + moved, a_csv=a, b_csv=b)


def test_signs_offsets_and_coupling_of_joints(tmp_path: Path) -> None:
    joints = (
        '[channels.q]\ncolumns = ["a", "b", "c", "d", "e", "f"]\nunit = "rad"\nsigma = 1e-5\n'
        "signs = [1, 1, -1, -1, -1, -1]\noffsets_deg = [0, -90, 0, 0, 0, 0]\n"
        "coupling = [[1,0,0,0,0,0],[0,1,0,0,0,0],[0,1,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,0,1]]\n"
    )
    data = read_dataset(lab(tmp_path, FILE + joints, a_csv="a,b,c,d,e,f\n0.1,0.2,0.3,0.4,0.5,0.6\n"))
    expected = [0.1, 0.2 - np.pi / 2, -0.5, -0.4, -0.5, -0.6]
    np.testing.assert_allclose(data.values("q")[0], expected, atol=1e-15)
    sigma = data.channel("q").sigma
    assert sigma is not None
    np.testing.assert_allclose(sigma[0], [1e-5, 1e-5, np.sqrt(2) * 1e-5, 1e-5, 1e-5, 1e-5])
    degrees = joints.replace("signs", "# ").replace("offsets_deg", "# ").replace("coupling", "# ")
    assert "Check unit" in fault(tmp_path, FILE + degrees, a_csv="a,b,c,d,e,f\n10,20,-30,40,50,60\n")


def test_frames_and_the_sign_of_forces(tmp_path: Path) -> None:
    turned = PULL + 'frame = "ros"\nacts_on = "surroundings"\n[frames.ros]\na_deg = 180\nx_mm = 100\n'
    data = read_dataset(lab(tmp_path, FILE + turned, a_csv="Fx,Fy,Fz\n1,2,3\n"))
    np.testing.assert_allclose(data.values("f_tcp_base"), [[1, 2, -3]], atol=1e-12)
    point = '[channels.p_base_tcp]\ncolumns = ["Fx", "Fy", "Fz"]\nunit = "mm"\nframe = "ros"\nsigma = [1, 2, 3]\n'
    moved = read_dataset(
        lab(tmp_path, f"{FILE}{point}[frames.ros]\na_deg = 90\nx_mm = 100\n", a_csv="Fx,Fy,Fz\n1,2,3\n")
    )
    np.testing.assert_allclose(moved.values("p_base_tcp"), [[0.098, 0.001, 0.003]], atol=1e-15)
    np.testing.assert_allclose(moved.channel("p_base_tcp").need_sigma(), [[2e-3, 1e-3, 3e-3]], atol=1e-15)
    assert "no [frames.ros]" in fault(tmp_path, f'{FILE}{PULL}frame = "ros"\n', a_csv="Fx,Fy,Fz\n1,2,3\n")


def test_constants_and_two_quantities_in_one_channel(tmp_path: Path) -> None:
    wrench = (
        '[channels.w_tcp_base]\nconstant = [0, 0, -500, 0, 0, 20]\nunit = ["N", "N m"]\nsigma = [2, 0.5]\n'
        '[channels.temperature_c]\ncolumns = "T"\nunit = "°C"\n'
    )
    data = read_dataset(lab(tmp_path, FILE + wrench, a_csv="T\n20.5\n21\n"))
    np.testing.assert_array_equal(data.values("w_tcp_base"), [[0, 0, -500, 0, 0, 20]] * 2)
    np.testing.assert_array_equal(data.channel("w_tcp_base").sigma, [[2, 2, 2, 0.5, 0.5, 0.5]] * 2)
    assert "one sigma cannot stand" in fault(tmp_path, FILE + wrench.replace("[2, 0.5]", "2"), a_csv="T\n20.5\n")


def test_whole_numbers_are_whole(tmp_path: Path) -> None:
    number = '[channels.tool]\ncolumns = "t"\n'
    assert read_dataset(lab(tmp_path, FILE + number, a_csv="t\n1\n2\n")).values("tool").tolist() == [[1], [2]]
    assert "a.csv:3: column 't'" in fault(tmp_path, FILE + number, a_csv="t\n1\n2.5\n")


def test_parquet_is_read_like_csv(tmp_path: Path) -> None:
    frame = pl.DataFrame({"Fx": [1, 2], "Fy": [3.0, 4.0], "Fz": ["5", "6"], "who": ["a", None]})
    frame.write_parquet(tmp_path / "a.parquet")
    data = read_dataset(lab(tmp_path, '[[files]]\npath = "a.parquet"\n' + PULL))
    np.testing.assert_array_equal(data.values("f_tcp_base"), [[1, 3, 5], [2, 4, 6]])
    (tmp_path / "a.parquet").write_bytes(b"PAR1 not really")
    assert "not readable as a Parquet" in fault(tmp_path, '[[files]]\npath = "a.parquet"\n' + PULL)
    frame.with_columns(Fx=pl.Series([1.0, None])).write_parquet(tmp_path / "a.parquet")
    assert "a.parquet:2: column 'Fx'" in fault(tmp_path, '[[files]]\npath = "a.parquet"\n' + PULL)


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (("unit =", "units ="), "Did you mean 'unit'"),
        (("f_tcp_base", "f_tcp_bas"), "Did you mean 'f_tcp_base'"),
        (('kind = "pulls"', 'kind = "pull"'), "Did you mean 'pulls'"),
        (("sigma = 2.0", "sigma = -1"), "above zero"),
        (("sigma = 2.0", "sigma = nan"), "sigma"),
        (("sigma = 2.0", "sigma = inf"), "finite standard deviations"),
        (('"Fy"', '"Fx"'), "named twice"),
        (("sigma = 2.0", "sigma = 2.0\n[settings]\npayload_lb = 3"), "there is no such setting"),
        (("version = 1", "version = 2"), "newer"),
        (("[[files]]", "[files]"), "files"),
        (('"Fx"', "0"), "number from 1"),
        (("sigma = 2.0", 'sigma = 2.0\nrotation = "matrix"'), "no rotation"),
        (("sigma = 2.0", "sigma = 2.0\noffsets_deg = [1,1,1]"), "joint angles"),
        (("sigma = 2.0", "sigma = 2.0\nsigns = [1,-1]"), "signs has 2 values"),
        (('path = "a.csv"', 'path = "b.csv"'), "Did you mean a.csv"),
        (('path = "a.csv"', 'path = "a.csv"\nseparator = "ab"'), "one character"),
        (('path = "a.csv"', 'path = "a.csv"\ndecimal = ","'), "both a comma"),
        (('path = "a.csv"', 'path = "a.csv"\nencoding = "latin-9000"'), "no such encoding"),
        (('path = "a.csv"', 'path = "a.csv"\nheader_line = 20'), "not in the file"),
        (('path = "a.csv"', 'path = "a.csv"\nskip_lines = [2]'), "no rows"),
    ],
)
def test_faults_of_the_manifest_say_what_to_do(tmp_path: Path, change: tuple[str, str], wanted: str) -> None:
    (tmp_path / "a.csv").write_text("Fx,Fy,Fz\n1,2,3\n")
    path = tmp_path / "lab.toml"
    path.write_text((HEAD + FILE + PULL).replace(*change))
    with pytest.raises(FileFormatError) as found:
        read_dataset(path)
    assert wanted in str(found.value)


def test_the_fingerprint_is_of_manifest_and_files(tmp_path: Path) -> None:
    text = "Fx,Fy,Fz\n1,2,3\n"
    first = forces(tmp_path, "", text).fingerprint
    assert first == forces(tmp_path, "", text).fingerprint
    assert len({first, forces(tmp_path, "", text + " ").fingerprint, forces(tmp_path, "# x", text).fingerprint}) == 3
