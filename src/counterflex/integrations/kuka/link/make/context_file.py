"""Writes a context of KUKA RSI 4 and 5, one file (``.rsix``): objects, types of objects, and the editor's drawing."""

from __future__ import annotations

from typing import Final
from xml.sax.saxutils import quoteattr

from counterflex.integrations.kuka.link.make import blocks as rsi_blocks

_ELEMENTS: Final = {
    "double": "DoubleParameter",
    "int": "IntParameter",
    "text": "StringParameter",
    "stop": "EnumParameter",
    "frame": "EnumParameter",
}
_CHOICES: Final = {"stop": ("StopType", rsi_blocks.STOP_MODES), "frame": ("TrafoCosysType", rsi_blocks.FRAMES)}
_SUBSET: Final = {"ETHERNET": "Communication", "MAP2SEN_PREA": "Communication", "SEN_PREA": "Communication"}
_OTHERS: Final = "Motion Manipulation"
_LIBRARY: Final = {4: "2.0.2", 5: "2.1.3"}
_COLUMN, _WIDTH, _PITCH = 400.0, 169.0, 30.0


def context_file(blocks: tuple[rsi_blocks.ContextBlock, ...], major: int) -> str:
    """Text of ``NAME.rsix``.

    Args:
        major: 4 or 5.
    """
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<RsiContext xsi:schemaLocation="RsiContext RsiContext.xsd" SchemaVersion="2.0.0" '
        'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns="RsiContext">',
        '   <RsiObjects xmlns="RsiDriver">',
    ]
    for block in blocks:
        lines += _object(block)
    lines += [
        "   </RsiObjects>",
        '   <BlueprintCollections SchemaVersion="2.0.0" xmlns="RsiBlueprint">',
        f'      <BlueprintCollection Name="RSI" Version="{_LIBRARY[major]}">',
    ]
    used = [rsi_blocks.TYPES[kind] for kind in rsi_blocks.TYPES if any(block.kind == kind for block in blocks)]
    for subset in ("Communication", _OTHERS):
        lines.append(f'         <Subset Name="{subset}">')
        for kind in used:
            if _SUBSET.get(kind.name, _OTHERS) == subset:
                lines += _blueprint(kind)
        lines.append("         </Subset>")
    lines += ["      </BlueprintCollection>", "   </BlueprintCollections>", '   <Constructs xmlns="RsiConstruct">']
    lines += _drawing(blocks)
    return "\n".join([*lines, "   </Constructs>", "</RsiContext>", ""])


def _object(block: rsi_blocks.ContextBlock) -> list[str]:
    kind = block.type
    lines = [f'      <RsiObject ObjTypeId="{kind.number}" ObjType="{kind.mixed}" ObjId="{block.name}">']
    if block.wires:
        lines.append("         <Inputs>")
        lines += [
            f'            <Input InIdx="{index - 1}" OutObjId="{source}" OutIdx="{output - 1}" />'
            for index, (source, output) in sorted(block.wires.items())
        ]
        lines.append("         </Inputs>")
    if block.values:
        lines.append("         <Parameters>")
        for item, value in block.given():
            more = 'IsPublic="true" ' if item.name in block.public else ""
            more += "" if item.runtime else 'IsRuntime="false" '
            text = quoteattr(item.ordinal(value))
            lines.append(
                f'            <Parameter {more}Name="{item.name}" ParamId="{item.second}" ParamValue={text} />'
            )
        lines.append("         </Parameters>")
    return [*lines, "      </RsiObject>"]


def _blueprint(kind: rsi_blocks.BlockType) -> list[str]:
    lines = [f'            <Element Name="{kind.mixed}" Id="{kind.number}">']
    for word, names in (("Input", kind.inputs), ("Output", kind.outputs)):
        if not names:
            continue
        lines.append(f"               <{word}s>")
        if kind.name == "ETHERNET":
            open_ = 'IsMandatory="false" ' if word == "Input" else ""
            lines.append(
                f'                  <{word} Name="{names[0]}" Index="0" {open_}IsDynamic="true" '
                f'DynamicCopiesCount="{len(names)}" />'
            )
        else:
            may = ' IsMandatory="false"' if kind.optional and word == "Input" else ""
            lines += [f'                  <{word} Name="{name}" Index="{i}"{may} />' for i, name in enumerate(names)]
        lines.append(f"               </{word}s>")
    if kind.parameters:
        lines.append("               <Parameters>")
        for item in kind.parameters:
            lines += _blueprint_parameter(item)
        lines.append("               </Parameters>")
    return [*lines, "            </Element>"]


def _blueprint_parameter(item: rsi_blocks.ParameterType) -> list[str]:
    element = _ELEMENTS[item.kind]
    more = "" if item.runtime else ' CanBeSetAtRuntime="false"'
    more += "" if item.least is None else f' Min="{item.least}"'
    more += "" if item.most is None else f' Max="{item.most}"'
    if item.kind == "text":
        more += f' Default="{item.default}" RestrictionType="FileName"'
    elif item.kind not in _CHOICES:
        more += f' Default="{item.default}"'
    else:
        name, values = _CHOICES[item.kind]
        return [
            f'                  <{element} Name="{item.name}" Index="{item.second}"{more} EnumType="{name}" '
            f'Default="{item.default}">',
            "                     <EnumValues>",
            *(f"                        <Value>{value}</Value>" for value in values),
            "                     </EnumValues>",
            f"                  </{element}>",
        ]
    return [f'                  <{element} Name="{item.name}" Index="{item.second}"{more} />']


def _drawing(blocks: tuple[rsi_blocks.ContextBlock, ...]) -> list[str]:
    named = {block.name: block for block in blocks}
    below: dict[float, float] = {}
    place: dict[str, tuple[float, float]] = {}
    for block in blocks:
        x = _COLUMN if block.kind == "ETHERNET" else 0.0 if not block.wires else 2.0 * _COLUMN
        place[block.name] = (x, below.get(x, 0.0))
        below[x] = below.get(x, 0.0) + 60.0 + _PITCH * max(1, *rsi_blocks.used_ports(blocks, block))
    lines = []
    for block in blocks:
        x, y = place[block.name]
        lines.append(
            f'      <Construct Name="{block.name}" BlueprintName="{block.type.mixed}" BlueprintCollection="RSI" '
            f'Location="{x:g},{y:g}">'
        )
        if block.wires:
            lines.append("         <Inputs>")
            for index, (source, output) in sorted(block.wires.items()):
                port = named[source].type.outputs[output - 1]
                sx, sy = place[source]
                ends = ((sx + _WIDTH, sy + 19.5 + _PITCH * (output - 1)), (x - 18.0, y + 19.5 + _PITCH * (index - 1)))
                middle = 0.5 * (ends[0][0] + ends[1][0])
                way = (ends[0], (middle, ends[0][1]), (middle, ends[1][1]), ends[1])
                points = ";".join(f"{px:g},{py:g}" for px, py in way)
                lines.append(
                    f'            <Input Name="{block.type.inputs[index - 1]}" SourceObject="{source}" '
                    f'SourcePort="{port}" Points="{points}" />'
                )
            lines.append("         </Inputs>")
        if block.values:
            lines.append("         <Parameters>")
            for item, value in block.given():
                krl = ' CanBeSetFromKrl="true"' if item.name in block.public else ""
                text = quoteattr(rsi_blocks.spelled(value))
                lines.append(f'            <{_ELEMENTS[item.kind]} Name="{item.name}"{krl} Value={text} />')
            lines.append("         </Parameters>")
        lines.append("      </Construct>")
    return lines
