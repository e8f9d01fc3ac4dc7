"""Solids as Open CASCADE itself writes them: names of faces, units, tolerances, with no code of counterflex."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any


def occ(name: str) -> Any:
    return getattr(import_module("OCP." + name.partition("_")[0]), name)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Any:
    return occ("BRepPrimAPI_MakeBox")(occ("gp_Pnt")(*low), occ("gp_Pnt")(*high)).Shape()


def cylinder(foot: tuple[float, float, float], radius: float, height: float) -> Any:
    axis = occ("gp_Ax2")(occ("gp_Pnt")(*foot), occ("gp_Dir")(0.0, 0.0, 1.0))
    return occ("BRepPrimAPI_MakeCylinder")(axis, radius, height).Shape()


def less(shape: Any, *tools: Any) -> Any:
    for tool in tools:
        shape = occ("BRepAlgoAPI_Cut")(shape, tool).Shape()
    return shape


def solids(shape: Any) -> list[Any]:
    found = import_module("OCP.collections").IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher()
    occ("TopExp").MapShapes_s(shape, occ("TopAbs_ShapeEnum").TopAbs_SOLID, found)
    return [found.FindKey(k + 1) for k in range(found.Extent())]


def faces(shape: Any) -> list[Any]:
    found = import_module("OCP.collections").IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher()
    occ("TopExp").MapShapes_s(shape, occ("TopAbs_ShapeEnum").TopAbs_FACE, found)
    return [found.FindKey(k + 1) for k in range(found.Extent())]


def centre(face: Any) -> tuple[float, float, float]:
    """Centre of area."""
    props = occ("GProp_GProps")()
    occ("BRepGProp").SurfaceProperties_s(face, props)
    place = props.CentreOfMass()
    return place.X(), place.Y(), place.Z()


def thickness(face: Any, axis: int) -> float:
    """Extent of a face along an axis of the part."""
    bounds = occ("Bnd_Box")()
    occ("BRepBndLib").AddOptimal_s(face, bounds, False, False)
    low, high = bounds.CornerMin(), bounds.CornerMax()
    return float([high.X() - low.X(), high.Y() - low.Y(), high.Z() - low.Z()][axis])


_METRES = {"MM": 1e-3, "INCH": 25.4e-3, "M": 1.0}
_WITH_DATUM = ("Parallelism", "Perpendicularity", "Angularity")
Named = Callable[[Any], str]
"""Name of a face; empty: none."""


def write_step(
    path: Path,
    shapes: Iterable[Any],
    named: Named = lambda _: "",
    *,
    unit: str = "MM",
    zones: Iterable[tuple[str, str, float]] = (),
    diameters: Collection[tuple[str, float, float, float]] = (),
) -> None:
    """Write solids (mm) as AP242.

    Args:
        zones: Face, type of tolerance, width in the unit of the file.
        diameters: Face, nominal value, upper and lower deviation, in the unit of the file.
    """
    out = occ("Message_PrinterOStream").get_type_descriptor_s()
    occ("Message").DefaultMessenger_s().RemovePrinters(out)
    writer, static = occ("STEPCAFControl_Writer")(), occ("Interface_Static")
    static.SetCVal_s("write.step.unit", unit)
    static.SetIVal_s("write.step.schema", 5)
    static.SetIVal_s("write.stepcaf.subshapes.name", 1)
    writer.SetDimTolMode(True)
    writer.SetNameMode(True)
    text, name = occ("TCollection_ExtendedString"), occ("TDataStd_Name")
    document = occ("TDocStd_Document")(text("XmlXCAF"))
    tool = occ("XCAFDoc_DocumentTool")
    parts, table = tool.ShapeTool_s(document.Main()), tool.DimTolTool_s(document.Main())
    labels = {}
    for shape in shapes:
        label = parts.AddShape(shape, False)
        name.Set_s(label, text("block"))
        for face in faces(shape):
            own = named(face)
            if own:
                labels[own] = parts.AddSubShape(label, face)
                name.Set_s(labels[own], text(own))
    for face, kind, width in zones:
        one, label = occ("XCAFDimTolObjects_GeomToleranceObject")(), table.AddGeomTolerance()
        one.SetType(occ(f"XCAFDimTolObjects_GeomToleranceType_{kind}"))
        if kind == "Position":
            one.SetTypeOfValue(occ("XCAFDimTolObjects_GeomToleranceTypeValue_Diameter"))
        # the writer states zones in m where the file has no dimension
        one.SetValue(width if diameters else width * _METRES[unit])
        occ("XCAFDoc_GeomTolerance").Set_s(label).SetObject(one)
        table.SetGeomTolerance(labels[face], label)
        if kind in _WITH_DATUM:
            datum, place = occ("XCAFDimTolObjects_DatumObject")(), table.AddDatum()
            datum.SetName(occ("TCollection_HAsciiString")("A"))
            datum.SetPosition(1)
            occ("XCAFDoc_Datum").Set_s(place).SetObject(datum)
            some = import_module("OCP.collections").Sequence_TDF_Label()
            some.Append(labels[face])
            table.SetDatum(some, place)
            table.SetDatumToGeomTol(place, label)
    for face, value, up, low in diameters:
        one, label = occ("XCAFDimTolObjects_DimensionObject")(), table.AddDimension()
        one.SetType(occ("XCAFDimTolObjects_DimensionType_Size_Diameter"))
        one.SetValue(value)
        one.SetUpperTolValue(up)
        one.SetLowerTolValue(low)
        occ("XCAFDoc_Dimension").Set_s(label).SetObject(one)
        table.SetDimension(labels[face], label)
    assert writer.Transfer(document, occ("STEPControl_StepModelType").STEPControl_AsIs)
    writer.Write(str(path))
    # Open CASCADE keeps these settings for the process
    static.SetCVal_s("write.step.unit", "MM")
