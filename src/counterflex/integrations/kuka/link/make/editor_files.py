"""Writes a context of KUKA RSI 3: what the controller reads (``.rsi.xml``) and the editor's model and drawing of it."""

from __future__ import annotations

import uuid
from typing import Final
from xml.sax.saxutils import quoteattr

from counterflex.integrations.kuka.link.make.blocks import ContextBlock, spelled, used_ports

_HEAD: Final = '<?xml version="1.0" encoding="utf-8"?>'
_WHOLE_RANGE: Final = (-2147483648, 2147483647)
_KINDS: Final = {
    "double": "System.Double",
    "int": "System.Int32",
    "text": "System.FileName",
    "stop": "KUKA.RSIVisual.RSI_StopType",
    "frame": "KUKA.RSIVisual.RSI_TrafoCosys",
}
_CONNECTOR: Final = "e3f2b7da-330d-4daf-bd29-4d4ed734c0af"
_WIDTH, _PITCH, _PORT_X, _PORT_Y = 1.5, 0.4, 0.4, 0.075


def controller_file(blocks: tuple[ContextBlock, ...]) -> str:
    """Text of ``NAME.rsi.xml``."""
    lines = [
        '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>',
        '<RSIObjects xsi:noNamespaceSchemaLocation="/Roboter/Config/System/Common/Schemes/RSIContext.xsd" '
        'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">',
    ]
    for block in blocks:
        lines.append(f'  <RSIObject ObjType="{block.kind}" ObjTypeID="{block.type.number}" ObjID="{block.name}">')
        if block.wires:
            lines.append("    <Inputs>")
            lines += [
                f'      <Input InIdx="{index}" OutObjID="{source}" OutIdx="{output}" />'
                for index, (source, output) in sorted(block.wires.items())
            ]
            lines.append("    </Inputs>")
        if block.values:
            lines.append("    <Parameters>")
            for item, value in block.given():
                more = "" if item.runtime else ' IsRuntime="false"'
                more += ' IsPublic="true"' if item.name in block.public else ""
                text = quoteattr(item.ordinal(value))
                lines.append(f'      <Parameter Name="{item.name}" ParamID="{item.first}" ParamValue={text}{more} />')
            lines.append("    </Parameters>")
        lines.append("  </RSIObject>")
    return "\n".join([*lines, "</RSIObjects>", ""])


def model_file(blocks: tuple[ContextBlock, ...]) -> str:
    """Text of ``NAME.rsi``."""
    named = {block.name: block for block in blocks}
    lines = [
        _HEAD,
        '<rSIModel dslVersion="1.0.0.0" name="" xmlns="http://schemas.microsoft.com/dsltools/RSIVisual">',
        "  <rSIObjects>",
    ]
    for block in blocks:
        many = 64 if block.kind == "ETHERNET" else 0
        lines.append(
            f'    <rSIElement name="{block.name}" objType="{block.kind}" objTypeID="{block.type.number}" '
            f'maxInputs="{many}" maxOutputs="{many}">'
        )
        lines += _in_ports(block, blocks, named)
        outputs = block.type.outputs[: used_ports(blocks, block)[1]]
        if outputs:
            lines.append("      <rSIOutPorts>")
            for name in outputs:
                whole = ' signalType="Int"' if name in block.type.whole else ""
                lines.append(f'        <rSIOutPort name="{name}"{whole} />')
            lines.append("      </rSIOutPorts>")
        if block.values:
            lines.append("      <rSIParameters>")
            lines += _parameters(block)
            lines.append("      </rSIParameters>")
        lines.append("    </rSIElement>")
    return "\n".join([*lines, "  </rSIObjects>", "</rSIModel>", ""])


def _in_ports(block: ContextBlock, blocks: tuple[ContextBlock, ...], named: dict[str, ContextBlock]) -> list[str]:
    inputs = block.type.inputs[: used_ports(blocks, block)[0]]
    if not inputs:
        return []
    lines = ["      <rSIInPorts>"]
    for index, name in enumerate(inputs, start=1):
        kind = ' mandatory="false"' if block.type.optional else ""
        kind += ' signalType="Bool"' if block.type.truth else ""
        if index not in block.wires:
            lines.append(f'        <rSIInPort name="{name}"{kind} />')
            continue
        source, output = block.wires[index]
        port = named[source].type.outputs[output - 1]
        lines += [
            f'        <rSIInPort name="{name}"{kind}>',
            "          <source>",
            f'            <rSIOutPortMoniker name="//{source}/{port}" />',
            "          </source>",
            "        </rSIInPort>",
        ]
    return [*lines, "      </rSIInPorts>"]


def _parameters(block: ContextBlock) -> list[str]:
    lines = []
    for item, value in block.given():
        low, high = (item.least, item.most) if item.kind == "int" else (item.least, None)
        low, high = _WHOLE_RANGE[0] if low is None else low, _WHOLE_RANGE[1] if high is None else high
        choice = "true" if item.kind in ("stop", "frame") else "false"
        more = "" if item.runtime else ' isRuntime="false"'
        more += ' isPublic="true"' if item.name in block.public else ""
        lines.append(
            f'        <rSIParameter name="{item.name}" value={quoteattr(spelled(value))} '
            f'paramType="{_KINDS[item.kind]}" minVal="{low}" maxVal="{high}" isEnum="{choice}"{more} '
            f'index="{item.first}" />'
        )
    return lines


def diagram_file(blocks: tuple[ContextBlock, ...], name: str) -> str:
    """Text of ``NAME.rsi.diagram``: objects in columns, sources left of what they feed."""
    place = _places(blocks)
    wide = max(x for x, _ in place.values()) + 3.0
    high = max(y + _height(blocks, block) for block in blocks for _, y in [place[block.name]]) + 1.0
    lines = [
        _HEAD,
        f'<rSIObjectDiagram dslVersion="1.0.0.0" absoluteBounds="0, 0, {wide:g}, {high:g}" name="{name}">',
        '  <rSIModelMoniker name="/" />',
        "  <nestedChildShapes>",
    ]
    for block in blocks:
        lines += _shape(blocks, block, place[block.name])
    named = {block.name: block for block in blocks}
    for block in blocks:
        for index, (source, output) in sorted(block.wires.items()):
            lines += _connector(block, index, named[source], output, place)
    return "\n".join([*lines, "  </nestedChildShapes>", "</rSIObjectDiagram>", ""])


def _places(blocks: tuple[ContextBlock, ...]) -> dict[str, tuple[float, float]]:
    below: dict[float, float] = {}
    place = {}
    for block in blocks:
        x = 5.0 if block.kind == "ETHERNET" else 1.0 if not block.wires else 9.0
        y = below.get(x, 0.5)
        place[block.name] = (x, y)
        below[x] = y + _height(blocks, block) + 0.5
    return place


def _height(blocks: tuple[ContextBlock, ...], block: ContextBlock) -> float:
    return 0.5 + _PITCH * max(1, *used_ports(blocks, block)) + 0.25 * len(block.values)


def _id(*words: str) -> str:
    return str(uuid.uuid5(uuid.NAMESPACE_URL, "counterflex/" + "/".join(words)))


def _port_at(place: tuple[float, float], index: int, *, out: bool) -> tuple[float, float]:
    x = place[0] + _WIDTH if out else place[0] - _PORT_X
    return x, place[1] + 0.25 + _PITCH * (index - 1)


def _shape(blocks: tuple[ContextBlock, ...], block: ContextBlock, place: tuple[float, float]) -> list[str]:
    x, y = place
    height = _height(blocks, block)
    lines = [
        f'    <rSIElementShape Id="{_id(block.name)}" absoluteBounds="{x:g}, {y:g}, {_WIDTH:g}, {height:g}" '
        'fillColor="BlanchedAlmond">',
        f'      <rSIElementMoniker name="//{block.name}" />',
        "      <relativeChildShapes>",
    ]
    inputs, outputs = used_ports(blocks, block)
    for out, names in ((False, block.type.inputs[:inputs]), (True, block.type.outputs[:outputs])):
        word = "rSIOutPort" if out else "rSIInPort"
        for index, name in enumerate(names, start=1):
            px, py = _port_at(place, index, out=out)
            lines += [
                f'        <{word}Shape Id="{_id(block.name, word, name)}" '
                f'absoluteBounds="{px:g}, {py:g}, {_PORT_X:g}, {_PORT_Y:g}" fillColor="White">',
                f'          <{word}Moniker name="//{block.name}/{name}" />',
                "          <relativeChildShapes />",
                f"        </{word}Shape>",
            ]
    return [
        *lines,
        "      </relativeChildShapes>",
        "      <nestedChildShapes>",
        f'        <elementListCompartment Id="{_id(block.name, "list")}" '
        f'absoluteBounds="{x + 0.015:g}, {y + 0.51:g}, {_WIDTH - 0.03:g}, {max(0.25, height - 0.6):g}" '
        'name="RSIParameters" titleTextColor="Black" itemTextColor="Black" />',
        "      </nestedChildShapes>",
        "    </rSIElementShape>",
    ]


def _connector(
    block: ContextBlock, index: int, source: ContextBlock, output: int, place: dict[str, tuple[float, float]]
) -> list[str]:
    x1, y1 = _port_at(place[block.name], index, out=False)
    x2, y2 = _port_at(place[source.name], output, out=True)
    x2 += _PORT_X
    y1, y2 = y1 + 0.5 * _PORT_Y, y2 + 0.5 * _PORT_Y
    middle = 0.5 * (x1 + x2)
    points = "; ".join(f"({x:g} : {y:g})" for x, y in ((x1, y1), (middle, y1), (middle, y2), (x2, y2)))
    into, out = block.type.inputs[index - 1], source.type.outputs[output - 1]
    return [
        f'    <rSISignalConnector edgePoints="[{points}]" fixedFrom="Caller" fixedTo="Caller" '
        f'TargetRelationshipDomainClassId="{_CONNECTOR}">',
        "      <nodes>",
        f'        <rSIInPortShapeMoniker Id="{_id(block.name, "rSIInPort", into)}" />',
        f'        <rSIOutPortShapeMoniker Id="{_id(source.name, "rSIOutPort", out)}" />',
        "      </nodes>",
        "    </rSISignalConnector>",
    ]
