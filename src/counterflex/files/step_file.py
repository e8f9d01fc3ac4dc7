"""Solids of STEP files (ISO 10303-21) with names and tolerances of their faces, by Open CASCADE (extra ``step``)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError
from counterflex.core.file_content import readable
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.mesh_shape import CadFace, CadSolid

ENDINGS: Final = (".step", ".stp", ".p21")
CHORD_M: Final = 1.0 * UM
"""Largest distance of a triangle from its face."""
LARGEST_BYTES: Final = 200_000_000
MOST_TRIANGLES: Final = 3_000_000
_COARSE: Final = 20.0
"""Doubly curved faces are meshed so many times coarser and refined here: else it takes minutes and misses the limit."""
_BULGE: Final = 0.6
"""Largest distance of the middle of a side from the face, by that of a triangle, whose middle is further off."""
_FINEST_MM: Final = 0.02  # Shorter sides stay: at a pole the middle of two parameters is not that of two points
_ANGLE: Final = 0.5
_KINDS: Final = {"Plane": "plane", "Cylinder": "cylinder", "Cone": "cone", "Sphere": "sphere", "Torus": "torus"}
_ORIENTED: Final = {"plane": ("orientation", 1.0)}
# By the tolerance's type and the face's kind: quantity that is measured, and its +- tolerance by the width of the zone
_MEASURED: Final[dict[str, dict[str, tuple[str, float]]]] = {
    "Flatness": {"plane": ("flatness", 1.0)},
    "CircularityOrRoundness": {"cylinder": ("roundness", 1.0)},
    "Position": {"plane": ("position", 0.5), "cylinder": ("centre", 0.5)},
    "ProfileOfSurface": dict.fromkeys((*_KINDS.values(), "free form"), ("profile", 0.5)),
    **dict.fromkeys(("Perpendicularity", "Parallelism", "Angularity"), _ORIENTED),
}


StepSolid = tuple[str, Float, Float, Any]
"""Name, lower and upper corner of its box, m, and the shape (TopoDS_Shape) of one solid of a file."""


def read_step(path: Path, choose: Callable[[list[StepSolid]], StepSolid], reach_m: float) -> CadSolid:
    """Read one solid of a STEP file in m; the file states its unit.

    Args:
        choose: Chooses one of several solids.
        reach_m: See :class:`~counterflex.evaluate.inspection.mesh_shape.MeshShape`.

    Raises:
        FileFormatError: It cannot be read, is too large, holds no closed solid, or Open CASCADE is not installed.
    """
    _require(path)
    with readable(path, "a STEP file", "Export it again, as AP214 or AP242"):
        reader, document = _transferred(path)
        shapes, tolerances = (
            getattr(_occ("XCAFDoc_DocumentTool"), f"{kind}Tool_s")(document.Main()) for kind in ("Shape", "DimTol")
        )
        solids = list(_solids(shapes))
    if not solids:
        raise FileFormatError(
            "the STEP file holds no closed solid",
            where=str(path),
            value="open shells, surfaces, curves, or a mesh alone",
            hint="Repair the part in the CAD system and export it as a solid (manifold_solid_brep)",
        )
    shape = choose(solids)[3]
    with readable(path, "a STEP file", "Export it again, as AP214 or AP242"):
        table, names = _Faces(shape), _occ("XCAFDoc_ShapeTool")
        own = {table.number(names.GetShape_s(label)): text for label, text in _sub_labels(shapes)}
        faces = [_face(face, k, own.get(k, "")) for k, face in enumerate(table.shapes)]
        same = Counter(face.name for face in faces)
        faces = [
            replace(face, name=f"{face.name} (face {k + 1})") if same[face.name] > 1 else face
            for k, face in enumerate(faces)
        ]
        not_measured = _tolerances(tolerances, table, faces, _above_nominal(reader))
    return CadSolid(*_mesh(shape, table, path), faces, reach_m, tuple(not_measured))


def _occ(name: str) -> Any:
    """A class of Open CASCADE by its name, which begins with that of its package."""
    return getattr(import_module("OCP." + name.partition("_")[0]), name)


def _require(path: Path) -> None:
    try:
        import_module("OCP.STEPCAFControl")
    except ImportError as fault:
        raise FileFormatError(
            "STEP files are read by Open CASCADE, which is not installed",
            where=str(path),
            hint='Install it: pip install "counterflex[step]"',
        ) from fault
    with readable(path, "a STEP file"), path.open("rb") as stream:
        head, size = stream.read(2048), path.stat().st_size
    if b"ISO-10303-21" not in head:
        raise FileFormatError(
            "not a STEP file", where=str(path), value=repr(head[:20]), limit="ISO-10303-21 in its first line"
        )
    if size > LARGEST_BYTES:
        raise FileFormatError(
            "the STEP file is too large",
            where=str(path),
            value=f"{size / 1e6:.0f} MB",
            limit=f"<= {LARGEST_BYTES / 1e6:.0f} MB",
            hint="Export the one part, without its assembly",
        )


def _transferred(path: Path) -> tuple[Any, Any]:
    """Reader, and the document that it filled."""
    out = _occ("Message_PrinterOStream").get_type_descriptor_s()
    _occ("Message").DefaultMessenger_s().RemovePrinters(out)
    reader, static = _occ("STEPCAFControl_Reader")(), _occ("Interface_Static")
    reader.SetGDTMode(True)
    reader.SetNameMode(True)
    static.SetIVal_s("read.stepcaf.subshapes.name", 1)
    static.SetCVal_s("xstep.cascade.unit", "MM")
    if reader.ReadFile(str(path)) != _occ("IFSelect_ReturnStatus").IFSelect_RetDone:
        raise ValueError("its structure is damaged")
    document = _occ("TDocStd_Document")(_occ("TCollection_ExtendedString")("XmlXCAF"))
    if not reader.Transfer(document):
        raise ValueError("its shapes cannot be built")
    return reader, document


def _labels(fill: Callable[..., Any], *before: Any) -> Iterator[Any]:
    labels = import_module("OCP.collections").Sequence_TDF_Label()
    fill(*before, labels)
    for k in range(labels.Length()):
        yield labels.Value(k + 1)


def _name(label: Any) -> str:
    attribute = _occ("TDataStd_Name")()
    is_named = label.FindAttribute(_occ("TDataStd_Name").GetID_s(), attribute)
    return attribute.Get().ToExtString().strip() if is_named else ""


def _sub_labels(shapes: Any) -> Iterator[tuple[Any, str]]:
    """Labels of faces and their names."""
    for label in _labels(shapes.GetShapes):
        for sub in _labels(shapes.GetSubShapes_s, label):
            yield sub, _name(sub)


def _explored(shape: Any, kind: str) -> list[Any]:
    """Parts of a shape, each once."""
    parts = _shape_map()
    _occ("TopExp").MapShapes_s(shape, getattr(_occ("TopAbs_ShapeEnum"), f"TopAbs_{kind}"), parts)
    return [parts.FindKey(k + 1) for k in range(parts.Extent())]


def _shape_map() -> Any:
    return import_module("OCP.collections").IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher()


def _solids(shapes: Any) -> Iterator[StepSolid]:
    labels = [(label, _occ("XCAFDoc_ShapeTool").GetShape_s(label)) for label in _labels(shapes.GetFreeShapes)]
    for k, (label, solid) in enumerate((label, one) for label, shape in labels for one in _explored(shape, "SOLID")):
        box = _occ("Bnd_Box")()
        _occ("BRepBndLib").AddOptimal_s(solid, box, False, False)
        low, high = (np.array([p.X(), p.Y(), p.Z()]) * MM for p in (box.CornerMin(), box.CornerMax()))
        yield f"{_name(label) or 'solid'} ({k + 1})", low, high, solid


class _Faces:
    """Faces of a solid in the order of the file, found again wherever an assembly places them."""

    def __init__(self, solid: Any) -> None:
        self.shapes: list[Any] = _explored(solid, "FACE")
        self._map = _shape_map()
        for face in self.shapes:
            self._map.Add(self._unplaced(face))

    @staticmethod
    def _unplaced(shape: Any) -> Any:
        return shape.Located(_occ("TopLoc_Location")())

    def number(self, shape: Any) -> int:
        """Number of a face, from 0; -1: it is none of this solid."""
        return -1 if shape.IsNull() else int(self._map.FindIndex(self._unplaced(shape))) - 1


def _face(shape: Any, number: int, own: str) -> CadFace:
    surface = _occ("BRepAdaptor_Surface")(_occ("TopoDS").Face(shape))
    word = surface.GetType().name.rpartition("_")[2]
    kind = _KINDS.get(word, "free form")
    point, axis, radius = np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0
    if kind != "free form":
        geometry = getattr(surface, word)()
        line = geometry.Axis() if kind in ("plane", "cylinder", "cone", "torus") else geometry.Position()
        place, way = line.Location(), line.Direction()
        point, axis = np.array([place.X(), place.Y(), place.Z()]) * MM, np.array([way.X(), way.Y(), way.Z()])
        radius = geometry.Radius() * MM if kind in ("cylinder", "sphere") else 0.0
        if kind == "plane" and (shape.Orientation().name == "TopAbs_REVERSED") == geometry.Direct():
            axis = -axis
    return CadFace(own or f"face {number + 1} ({kind})", kind, point, axis, radius, {})


def _mesh(solid: Any, table: _Faces, path: Path) -> tuple[Float, Int, Int]:
    """Vertices, triangles and their faces, within :data:`CHORD_M` of the solid."""
    make, builder, ruled = _occ("BRepMesh_IncrementalMesh"), _occ("BRep_Builder")(), _occ("TopoDS_Compound")()
    builder.MakeCompound(ruled)
    for face in table.shapes:
        if (
            _occ("BRepAdaptor_Surface")(_occ("TopoDS").Face(face))
            .GetType()
            .name.endswith(("Plane", "Cylinder", "Cone"))
        ):
            builder.Add(ruled, face)
    make(ruled, CHORD_M / MM, False, _ANGLE, False)  # their edges too, which bound planes
    make(solid, _COARSE * CHORD_M / MM, False, _ANGLE, False)
    vertices, triangles, owner, count, left = [], [], [], 0, MOST_TRIANGLES
    for k, face in enumerate(table.shapes):
        points, corners = _triangles(face, left)
        left -= len(corners)
        if left <= 0:
            raise FileFormatError(
                "the solid has too many curved faces",
                where=str(path),
                value=f"more than {MOST_TRIANGLES} triangles within {CHORD_M / UM:g} um, {k + 1} of its faces read",
                hint="Leave out threads, text and knurls, or export a mesh (STL)",
            )
        turned = face.Orientation().name == "TopAbs_REVERSED"
        vertices.append(points * MM)
        triangles.append(corners[:, ::-1] + count if turned else corners + count)
        owner.append(np.full(len(corners), k))
        count += len(points)
    return np.concatenate(vertices), np.concatenate(triangles), np.concatenate(owner)


def _triangles(shape: Any, most: int) -> tuple[Float, Int]:
    """Vertices (mm) and triangles of one face, made finer until they are within :data:`CHORD_M`, or ``most`` many."""
    face = _occ("TopoDS").Face(shape)
    mesh, surface = (
        _occ("BRep_Tool").Triangulation_s(face, _occ("TopLoc_Location")()),
        _occ("BRepAdaptor_Surface")(face),
    )
    if mesh is None:
        raise ValueError("a face of it has no area")

    corners = np.array([mesh.Triangle(t + 1).Get() for t in range(mesh.NbTriangles())], np.int64).reshape(-1, 3) - 1
    nodes = (mesh.UVNode(n + 1) for n in range(mesh.NbNodes()))
    uv = np.array([(node.X(), node.Y()) for node in nodes]).reshape(-1, 2)
    points = _on(surface, uv)
    while surface.GetType().name != "GeomAbs_Plane" and len(corners) < most:
        sides = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
        edges, side = np.unique(sides, axis=0, return_inverse=True)
        middle = uv[edges].mean(axis=1)
        bulge = _on(surface, middle)
        off = np.linalg.norm(bulge - points[edges].mean(axis=1), axis=1) > _BULGE * CHORD_M / MM
        off &= np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1) > _FINEST_MM
        if not off.any():
            break
        number = np.where(off, len(uv) + np.cumsum(off) - 1, -1)[side.reshape(3, -1)].T
        uv, points = np.concatenate([uv, middle[off]]), np.concatenate([points, bulge[off]])
        corners = _split(corners, number)
    return points, corners


def _on(surface: Any, uv: Float) -> Float:
    """Points (n, 3) mm of a surface by their parameters (n, 2)."""
    places = (surface.Value(u, v) for u, v in uv.tolist())
    return np.array([(place.X(), place.Y(), place.Z()) for place in places]).reshape(-1, 3)


def _split(corners: Int, middle: Int) -> Int:
    """Triangles with the middles of their sides (t, 3) as new corners; -1 where a side stays whole."""
    out = [corners[(middle < 0).all(axis=1)]]
    for k in range(3):
        a, b, c = np.roll(corners, -k, axis=1).T
        ab, bc, ca = np.roll(middle, -k, axis=1).T
        one = (ab >= 0) & (bc < 0) & (ca < 0)
        two = (ab >= 0) & (bc >= 0) & (ca < 0)
        out += [np.stack(t, axis=1)[one] for t in ((a, ab, c), (ab, b, c))]
        out += [np.stack(t, axis=1)[two] for t in ((ab, b, bc), (a, ab, bc), (a, bc, c))]
    a, b, c = corners.T
    ab, bc, ca = middle.T
    every = (middle >= 0).all(axis=1)
    out += [np.stack(t, axis=1)[every] for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate(out)


def _above_nominal(reader: Any) -> set[float]:
    """Ratios of limits that lie on one side of the nominal size: Open CASCADE drops the sign of the lower one."""
    model, out = reader.Reader().WS().Model(), set()
    for k in range(model.NbEntities()):
        entity = model.Value(k + 1)
        if type(entity).__name__ == "StepShape_ToleranceValue":
            low, high = (bound.ValueComponent() for bound in (entity.LowerBound(), entity.UpperBound()))
            if low * high > 0.0:
                out.add(round(abs(low / high), 9))
    return out


def _tolerances(tool: Any, table: _Faces, faces: list[CadFace], above: set[float]) -> list[str]:
    """Put the tolerances of the file on their faces; returns those that are not measured, by name."""
    out = []
    read: tuple[tuple[str, Callable[..., Any], Callable[..., str]], ...] = (
        ("GeomTolerance", tool.GetGeomToleranceLabels, _zone),
        ("Dimension", tool.GetDimensionLabels, lambda one, some: _size(one, some, above)),
    )
    for kind, labels, put in read:
        for label in _labels(labels):
            one = _occ(f"XCAFDoc_{kind}").Set_s(label).GetObject()
            numbers = _faces_of(tool, label, table)
            if numbers is None:
                continue
            left = put(one, [faces[k] for k in numbers])
            if left:
                out.append(f"{left} of {', '.join(faces[k].name for k in numbers) or 'no face'}")
    return out


def _faces_of(tool: Any, label: Any, table: _Faces) -> list[int] | None:
    """Numbers of the faces that a tolerance is of; None: it is of another solid."""
    labels = import_module("OCP.collections").Sequence_TDF_Label
    first, second = labels(), labels()
    tool.GetRefShapeLabel_s(label, first, second)
    shapes = [_occ("XCAFDoc_ShapeTool").GetShape_s(s.Value(k + 1)) for s in (first, second) for k in range(s.Length())]
    faces = [face for shape in shapes for face in _explored(shape, "FACE")]
    numbers = [table.number(face) for face in faces]
    if numbers and max(numbers) < 0:
        return None
    return [number for number in numbers if number >= 0]


def _zone(one: Any, faces: list[CadFace]) -> str:
    """Put a geometrical tolerance on its faces; returns its name where it is not measured."""
    kind, width = one.GetType().name.rpartition("_")[2], one.GetValue()
    rows = [_MEASURED.get(kind, {}).get(face.kind) for face in faces]
    plain = (
        one.GetMaterialRequirementModifier().name.endswith("_None")
        and one.GetZoneModifier().name.endswith("_None")
        and one.GetModifiers().Length() == 0
    )
    if kind == "Position" and any(face.kind == "cylinder" for face in faces):
        plain &= one.GetTypeOfValue().name.endswith("_Diameter")
    if not plain or not rows or None in rows:
        return f"{kind} {width:g} mm" + ("" if plain else " with its modifiers")
    for face, row in zip(faces, rows, strict=True):
        quantity, share = row or ("", 0.0)
        tighter = min(share * width * MM, face.limits.get(quantity, (None, np.inf))[1])
        face.limits[quantity] = (None, tighter)
    return ""


def _limits_of(one: Any) -> tuple[float, float, float] | None:
    """Size, upper and lower deviation, mm; None: it has no tolerance."""
    if one.IsDimWithRange():
        return one.GetLowerBound(), one.GetUpperBound() - one.GetLowerBound(), 0.0
    if one.IsDimWithPlusMinusTolerance():
        return one.GetValue(), one.GetUpperTolValue(), one.GetLowerTolValue()
    return (one.GetValue(), 0.0, 0.0) if one.IsDimWithClassOfTolerance() else None


def _size(one: Any, faces: list[CadFace], above: set[float]) -> str:
    """Put the limits of a diameter on its faces; returns the name of a size that is not measured."""
    limits, kind = _limits_of(one), one.GetType().name.rpartition("Type_")[2].replace("_", " ")
    if limits is None:
        return ""
    value, up, low = limits
    scale = {"Size Diameter": 1.0, "Size Radius": 2.0}.get(kind)
    one_sided = up > 0.0 and round(low / up, 9) in above
    round_faces = bool(faces) and all(face.kind == "cylinder" for face in faces)
    if scale is None or up + low <= 0.0 or one_sided or not round_faces:
        return f"{kind} {value:g} mm" + (" with both limits on one side" if one_sided else "")
    for face in faces:
        face.limits["diameter"] = (scale * (value + 0.5 * (up - low)) * MM, scale * 0.5 * (up + low) * MM)
    return ""
