"""Table ``[sensor.frame]`` of a cell file: frames of a force sensor as its manual describes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.errors import CounterflexError
from counterflex.files.schema import Table
from counterflex.protocols.force.frame_format import FrameField, FrameFormat

if TYPE_CHECKING:
    from counterflex.protocols.frame.link import FrameSource

Hex = Annotated[str, Field(pattern=r"^([0-9a-fA-F]{2})*$", max_length=128)]
Six = tuple[float, float, float, float, float, float]
Bits = Annotated[int, Field(ge=0, le=0xFFFFFFFF)]
Counts = Annotated[float, Field(gt=0.0, le=1e12)]


class FrameTable(Table):
    """One frame: bytes as hexadecimal digits, fields as ``"TYPE NAME"`` in their order."""

    transport: Literal["udp", "tcp"] = "udp"
    start: Hex = ""
    stop: Hex = ""
    request: Hex = ""
    header: Hex = ""
    footer: Hex = ""
    byte_order: Literal["little", "big"]
    fields: Annotated[tuple[str, ...], Field(min_length=6, max_length=64)]
    counts_per_n: Counts | None = None
    counts_per_nm: Counts | None = None
    matrix: tuple[Six, Six, Six, Six, Six, Six] | None = None
    crc_from: Annotated[int, Field(ge=0, le=511)] = 0
    saturated_bits: Bits = 0
    invalid_bits: Bits = 0

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.matrix is not None and (self.counts_per_n is not None or self.counts_per_nm is not None):
            raise ValueError("matrix excludes counts_per_n and counts_per_nm; put the counts into the matrix")
        if (self.counts_per_n is None) != (self.counts_per_nm is None):
            raise ValueError("counts_per_n and counts_per_nm belong together; give both or none")
        if self.matrix is None and any(" ch" in text for text in self.fields):
            raise ValueError("channels ch1 .. ch6 need a matrix; components are named fx fy fz mx my mz")
        try:
            self.source()
        except CounterflexError as fault:
            raise ValueError(str(fault)) from fault
        return self

    def source(self) -> FrameSource:
        """Frames and how they are had.

        Raises:
            InputError: Fields, matrix or transport that cannot be.
        """
        from counterflex.protocols.frame.link import FrameSource

        fields = []
        for text in self.fields:
            kind, _, name = text.partition(" ")
            fields.append(FrameField(kind, name))
        counts = np.repeat([self.counts_per_n or 1.0, self.counts_per_nm or 1.0], 3)
        frame = FrameFormat(
            tuple(fields),
            np.diag(1.0 / counts) if self.matrix is None else np.array(self.matrix),
            bytes.fromhex(self.header),
            bytes.fromhex(self.footer),
            self.byte_order == "little",
            self.crc_from,
            self.saturated_bits,
            self.invalid_bits,
        )
        hexes = (bytes.fromhex(value) for value in (self.start, self.stop, self.request))
        return FrameSource(frame, self.transport, *hexes)
