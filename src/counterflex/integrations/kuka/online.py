"""The link of a run to a KUKA robot: RSI by its configuration."""

from __future__ import annotations

from typing import Final

from counterflex.app.robot_axes import axes_in
from counterflex.app.run.robot_links import LinkOrder, RobotLinkKind
from counterflex.core.errors import InputError
from counterflex.protocols.kuka_rsi.config import read_config
from counterflex.protocols.kuka_rsi.link import RsiLink
from counterflex.runtime.plausibility.axis_check import ABSENT
from counterflex.runtime.settings import Output

_RSI_MS = (4, 12)


def rsi_link(order: LinkOrder) -> RsiLink:
    """Open the link of an ETHERNET configuration file.

    Raises:
        FileFormatError: The file cannot be used.
        InputError: RSI has no such cycle, or the configuration does not take in what the loop sends.
        OutputError: The port cannot be bound.
    """
    online, file = order.online, order.file
    assert file is not None
    if round(online.period_s * 1e3) not in _RSI_MS:
        raise InputError("cycle of RSI", value=f"{online.period_s * 1e3:g} ms", limit="4 or 12 ms: [online] period_ms")
    axes = axes_in(order.cell, "krl")[0]
    link = RsiLink(
        read_config(file), host=order.host, port=order.port, peer=order.peer, period_s=online.period_s, axes=axes
    )
    by_axes = online.output == Output.AXES
    missing, hint = "", ""
    if by_axes and not link.axis_specific:
        missing, hint = (
            "takes in no axis corrections",
            'Add AKorr.A1 to AKorr.A6 (AXISCORR), or set output = "cartesian"',
        )
    elif not by_axes and not link.cartesian:
        missing, hint = "takes in no Cartesian correction", 'Add RKorr.X to RKorr.C (POSCORR), or set output = "axes"'
    elif order.overriding and not link.overriding:
        missing, hint = "takes in no speed of the program", "Add the tag Override, or leave the table [override] out"
    elif order.currents and not link.has_currents:
        missing, hint = "sends no motor currents", "Add DEF_MACur to SEND, or leave out run.currents"
    elif online.axis_pid is not None and link.measured_is == ABSENT:
        missing = "sends no measured pose, which a PID per axis needs"
        hint = "Add DEF_RIst to SEND, or leave out the table [online.axis_pid]"
    if missing:
        link.close()
        raise InputError(f"the RSI configuration {missing}", where=str(file), hint=hint)
    return link


LINK: Final = RobotLinkKind(
    title="KUKA RSI",
    how="--rsi FILE for a KUKA robot",
    open=rsi_link,
    read=read_config,
    simulated="counterflex.integrations.kuka.alone:controller",
    alone="counterflex.integrations.kuka.alone:alone",
)
