"""Rules about the ETHERNET file of a KUKA RSI set-up."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterator
from typing import Final

from counterflex.integrations.kuka.link.whole_setup import AXIS_WORDS, POSE, Rule, Setup
from counterflex.protocols.finding import Finding

_AXES: Final = tuple(f"A{i}" for i in range(1, 7))
_SENTYPE: Final = re.compile(r"[A-Za-z0-9_.-]{1,32}")
_FREE_FROM: Final = 1024
_FORCE_SENSOR_PORT: Final = 49152


def tags_sent(setup: Setup) -> Iterator[Finding]:
    """Check the tags that the loop needs: commanded pose and axes, late answers, clamping, the program's own enable."""
    sent = setup.sent
    needed = (
        ("RSol.X", "error", "the commanded pose is not sent, and RIst contains the correction", "DEF_RSol"),
        ("ASPos.A1", "warning", "commanded axis angles are not sent, and AIPos contains the correction", "DEF_ASPos"),
        ("RIst.X", "warning", "the actual pose is not sent: silent clamping cannot be seen", "DEF_RIst"),
        ("Delay.D", "warning", "late answers are not sent: nobody sees the Timeout come", "DEF_Delay"),
        ("Enable", "warning", "the program cannot switch the correction: it acts whenever armed", "Enable"),
    )
    for name, severity, what, tag in needed:
        if name == "ASPos.A1" and "AIPos.A1" not in sent and name not in sent:
            severity, what = "error", "no axis angles are sent"
        if name not in sent:
            yield Finding(
                "missing-tag", "error" if severity == "error" else "warning", setup.at("SEND"), what, f"no {tag}",
                f"{tag} declared", f"Add {tag} to SEND",
            )  # fmt: skip
    if setup.corrections and not any(name.endswith(".Stat") for name in sent):
        yield Finding(
            "missing-stat", "warning", setup.at("SEND"),
            "the status of the correction object is not sent: it clamps in silence", "no tag NAME.Stat",
            "NAME.Stat wired to output Stat of POSCORR or AXISCORR",
            'Add TAG="Corr.Stat" TYPE="LONG" to SEND and wire it',
        )  # fmt: skip


def stop_tag(setup: Setup) -> Iterator[Finding]:
    """The loop must be able to stop the robot."""
    if setup.corrections and "Stop" not in setup.received:
        yield Finding(
            "missing-stop", "error", setup.at("RECEIVE"), "a fault of the loop cannot stop the robot", "no Stop",
            "Stop declared and wired to a STOP object", 'Add TAG="Stop" TYPE="BOOL" to RECEIVE',
        )  # fmt: skip


def only_send(setup: Setup) -> Iterator[Finding]:
    """ONLYSEND means that no answer is read."""
    if setup.config.only_send and setup.corrections:
        yield Finding(
            "only-send", "error", setup.at("CONFIG ONLYSEND"),
            "corrections are declared, but the controller reads no answer", "TRUE", "FALSE where corrections are sent",
            "Set ONLYSEND to FALSE, or take the corrections out to watch only",
        )  # fmt: skip
    if setup.config.only_send and not setup.corrections and setup.limits is not None:
        yield Finding(
            "only-send", "warning", setup.at("CONFIG ONLYSEND"),
            "the cell wants to correct online, but this file only watches", "TRUE", "FALSE and a correction in RECEIVE",
            "Use another file for counterflex run",
        )  # fmt: skip


def corrections_declared(setup: Setup) -> Iterator[Finding]:
    """A correction must be there, whole, of type DOUBLE, and the one that the cell sends."""
    pose = [value.name for value in setup.pose_values]
    if not setup.corrections and not setup.config.only_send:
        yield Finding(
            "no-correction", "error", setup.at("RECEIVE"), "there is no correction", "neither RKorr nor AKorr",
            "RKorr.X to RKorr.C, or AKorr.A1 to AKorr.A6",
            "Add one of them to RECEIVE, or set ONLYSEND to TRUE to watch only",
        )  # fmt: skip
    required = [(pose, POSE)]
    for word in AXIS_WORDS:
        declared = [value.name for value in setup.axis_values if value.element == word]
        required.append((declared, tuple(f"{word}.{axis}" for axis in _AXES)))
    for declared, whole in required:
        missing = [name for name in whole if name not in declared]
        if declared and missing:
            yield Finding(
                "partly-declared", "error", setup.at("RECEIVE"),
                "the correction is declared in part: the rest of it would never reach the robot",
                f"no {', '.join(missing)}", f"all of {whole[0]} to {whole[-1]}", "Add the missing tags",
            )  # fmt: skip
    for value in setup.corrections:
        if value.kind != "DOUBLE":
            yield Finding(
                "type", "error", setup.at(value.tag.tag), "the correction would be rounded to whole mm or deg",
                f"TYPE {value.kind}", "TYPE DOUBLE", "Change the TYPE",
            )  # fmt: skip
    if setup.limits is not None and setup.corrections:
        other = setup.pose_values if setup.limits.axes else setup.axis_values
        own = setup.axis_values if setup.limits.axes else setup.pose_values
        if other and not own:
            name = "AKorr" if setup.limits.axes else "RKorr"
            yield Finding(
                "output", "error", setup.at("RECEIVE"),
                f"the cell sends {'axis' if setup.limits.axes else 'Cartesian'} corrections, this file takes none",
                f"no {name}", f"{name} declared", "Change RECEIVE, or online.output in the cell file",
            )  # fmt: skip


def sent_types(setup: Setup) -> Iterator[Finding]:
    """Poses and angles must come with decimals."""
    for tag in setup.config.send:
        word = tag.tag.removeprefix("DEF_")
        if tag.tag.startswith("DEF_") and word in ("RIst", "RSol", "AIPos", "ASPos") and tag.kind != "DOUBLE":
            yield Finding(
                "type", "error", setup.at(tag.tag), "the value would be rounded to whole mm or deg", f"TYPE {tag.kind}",
                "TYPE DOUBLE", "Change the TYPE",
            )  # fmt: skip


def both_corrections(setup: Setup) -> Iterator[Finding]:
    """Axis and Cartesian corrections add up; only one may act."""
    if not setup.pose_values or not setup.axis_values:
        return
    if setup.context is None:
        yield Finding(
            "both-corrections", "warning", setup.at("RECEIVE"),
            "axis and Cartesian corrections are both declared; wired both, they add up", "RKorr and AKorr",
            "only one of them wired in the context", "Give the context with --context, or take one of them out",
        )  # fmt: skip
    elif setup.context.of_kind("POSCORR") and setup.context.of_kind("AXISCORR"):
        yield Finding(
            "both-corrections", "error", setup.context.where,
            "axis and Cartesian corrections are both wired: they add up", "POSCORR and AXISCORR", "one of them",
            "Take one object out of the context",
        )  # fmt: skip


def hold_on(setup: Setup) -> Iterator[Finding]:
    """Check the effect of a lost answer: HOLDON against the mode of RSI_ON."""
    holds = {value.tag.hold for value in setup.corrections}
    mode = setup.program.mode if setup.program else None
    if len(holds) > 1:
        yield Finding(
            "holdon-mixed",
            "error",
            setup.at("RECEIVE"),
            "corrections are held in part: a lost answer tears them apart",
            "HOLDON 0 and 1",
            "one value for all, 1 with #ABSOLUTE",
            "Make them alike",
        )
        return
    if mode == "relative" and True in holds:
        yield Finding(
            "holdon-relative",
            "error",
            setup.at("RECEIVE"),
            "a lost answer applies the last increment again: the correction drifts",
            'HOLDON="1" with #RELATIVE',
            'HOLDON="1" with #ABSOLUTE, or HOLDON="0" with #RELATIVE',
            "Switch RSI_ON to #ABSOLUTE",
        )
    elif mode != "relative" and False in holds:
        yield Finding(
            "holdon-absolute",
            "error",
            setup.at("RECEIVE"),
            "one lost answer jumps back to no correction in a single cycle",
            'HOLDON="0"' + (" with #ABSOLUTE" if mode else ", and counterflex sends total corrections (#ABSOLUTE)"),
            'HOLDON="1" with #ABSOLUTE',
            'Set HOLDON="1" on every correction',
        )


def override_held(setup: Setup) -> Iterator[Finding]:
    """A lost answer must not set the speed to zero, nor take a stop or a feed hold back."""
    for name in ("Override", "Stop", "FeedHold"):
        value = setup.received.get(name)
        if value is not None and not value.tag.hold:
            speed = name == "Override"
            yield Finding(
                "holdon-command", "error" if speed else "warning", setup.at(name),
                "one lost answer sets the speed to 0 %" if speed else f"a lost answer takes {name} back", 'HOLDON="0"',
                'HOLDON="1"', 'Set HOLDON="1"',
            )  # fmt: skip


def reserved_generator(setup: Setup) -> Iterator[Finding]:
    """Function generator 1 belongs to RSI itself."""
    for tag in setup.config.receive:
        if tag.tag == "DEF_Tech.T1":
            yield Finding(
                "generator-1", "error", setup.at(tag.tag), "function generator 1 is reserved: RSI_ON ends with RSIBad",
                tag.tag, "DEF_Tech.T2 to T6", "Use generator 2",
            )  # fmt: skip


def sentype(setup: Setup) -> Iterator[Finding]:
    """Both sides compare this text; it must not be mistaken for anything."""
    value = setup.config.sentype
    if value == "KUKA" or not _SENTYPE.fullmatch(value):
        yield Finding(
            "sentype",
            "warning",
            setup.at("CONFIG SENTYPE"),
            "answers are refused unless they carry exactly this text; the robot's own telegrams say KUKA"
            if value == "KUKA"
            else "answers are refused unless they carry exactly this text",
            repr(value),
            "up to 32 letters, digits, _ . -; not KUKA",
            "Choose a name of your own, for example Counterflex",
        )


def address(setup: Setup) -> Iterator[Finding]:
    """Check the address of telegrams."""
    where, text = setup.at("CONFIG IP_NUMBER"), setup.config.host
    safe = "address of the sensor computer in a network of its own, for example 192.168.44.10"
    try:
        value = ipaddress.IPv4Address(text)
    except ValueError:
        yield Finding("address", "error", where, "not an IPv4 address", text, safe, "Write the computer's address")
        return
    if value in ipaddress.IPv4Network("192.0.1.0/24"):
        yield Finding(
            "address", "error", where, "the network 192.0.1.x belongs to the inside of a KR C2", text, safe,
            "Take another network",
        )  # fmt: skip
    elif value.is_multicast or value.is_unspecified or text.endswith(".255"):
        yield Finding("address", "error", where, "not the address of one computer", text, safe, "Correct it")
    elif value.is_loopback:
        yield Finding(
            "address", "warning", where, "only a simulated robot on this computer reaches this address", text, safe,
            "Correct it before the file goes to a robot",
        )  # fmt: skip


def port(setup: Setup) -> Iterator[Finding]:
    """The sensor computer must be able to bind the port, alone."""
    where, value = setup.at("CONFIG PORT"), setup.config.port
    if value < _FREE_FROM:
        yield Finding(
            "port", "warning", where, "needs administrator rights", f"{value}", f">= {_FREE_FROM}", "Take another port"
        )
    for what, used in setup.ports.items():
        if used == value:
            yield Finding(
                "port", "error", where, f"{what} uses this port on the same computer", f"{value}", "a port of its own",
                "Change one of them",
            )  # fmt: skip
    if value == _FORCE_SENSOR_PORT and setup.config.host.startswith("127."):
        yield Finding(
            "port", "warning", where, "ATI force sensors use this port: a simulated one on this computer would clash",
            f"{value}", "another port, for example 59152", "Change it, or give the simulated sensor another port",
        )  # fmt: skip


RULES: Final[tuple[Rule, ...]] = (
    tags_sent,
    stop_tag,
    only_send,
    corrections_declared,
    sent_types,
    both_corrections,
    hold_on,
    override_held,
    reserved_generator,
    sentype,
    address,
    port,
)
