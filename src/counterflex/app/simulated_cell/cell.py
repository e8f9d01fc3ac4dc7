"""The simulated cell on real sockets, started by itself: controller, force sensor, tracker."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Job, Reading, read_job
from counterflex.app.plc import PLCS
from counterflex.app.proof import simulate
from counterflex.app.robot_programs import digest, inputs_of
from counterflex.app.run.job_check import program_job
from counterflex.app.run.robot_links import ROBOT_LINKS, Chosen, ControllerOrder, SimulatedController, chosen, values_of
from counterflex.app.simulated_cell.instruments import force_device
from counterflex.core import atomic
from counterflex.core.arrays import as_positive
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.registry import imported
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.sensing import PROTOCOL, strain_holder
from counterflex.files.scenario_file import Scenario
from counterflex.files.summary_file import write_folder_summary, write_run
from counterflex.twin.devices.force_device import ForceDevice, ForceStart
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.devices.robot_server import Timing
from counterflex.twin.devices.strain import StrainSender
from counterflex.twin.laboratory.laboratory import Laboratory, laboratory
from counterflex.twin.live.cell_server import CellServer, Instruments
from counterflex.twin.live.live_cell import LiveCell
from counterflex.twin.network.faults import Fault, FaultSchedule
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.strain_holder import WARM_K, StrainStream, instrumented_holder
from counterflex.twin.truth.file import read_truth, write_truth
from counterflex.twin.truth.truth import Truth


@dataclass(frozen=True)
class LiveSettings:
    """Settings of the simulated cell."""

    program: Path  # G-code that its robot runs
    cell: Path  # Cell file: what its controller believes
    truth: Path  # Truth file: how it really is
    # Name of the link to its controller and the file that it is set up by, or None: as the cell file says
    robot: Chosen | None = None
    original: Path | None = None  # The uncompensated program, to judge a compensated one; None is the program itself
    reading: Reading = AS_IT_IS  # How the programs are read
    peer: tuple[str, int] | None = None  # Where telegrams go, or None: where the controller's files say
    own_force: bool = False  # The controller sends the force sensor's readings itself
    # UDP port of the force sensor; 0 takes a free one, None leaves it out. Where the cell file's sensor sends by itself
    # (``protocol = "wrench"``): the port that it sends to.
    force_port: int | None = 0
    force_http_port: int = 0  # Of its scaling document
    force_host: str = "127.0.0.1"  # Where a sensor that sends by itself sends to
    tracker_peer: tuple[str, int] | None = None  # Where tracker datagrams go, or None
    tracker_hz: float = 1000.0  # Poses in a second; few are photogrammetry
    tracker_faults: tuple[Fault, ...] = ()  # Of the tracker and its datagrams, late ones among them
    force_faults: tuple[Fault, ...] = ()  # Of the force sensor and its records
    seed: int = 0  # Of the instruments
    timing: Timing = field(default_factory=lambda: Timing(gate_s=0.8))  # How the controller keeps time
    scenario: Scenario = field(default_factory=Scenario)  # With the table of the controller, if there is one
    answer: PathAnswer = field(default_factory=PathAnswer)  # How the controller answers corrections
    # Share of the play of its gears that the controller compensates itself; axis corrections go past it
    own_backlash: float = 0.0
    # Size of the hose pack's pull on the sensor, as in the simulated laboratory; 0 leaves it out
    hose_share: float = 1.0
    strain_peer: tuple[str, int] | None = None  # Where strain datagrams of the instrumented holder go, or None
    # Kind and address of a simulated PLC that shows the same strains by the symbols of its table in the cell file, or
    # None
    strain_plc: tuple[str, tuple[str, int]] | None = None
    strain_hz: int = 1000  # Readings in a second; the integration step of the cell divides the time between them
    strain_warm_k: float = WARM_K  # How much the holder warms up
    strain_faults: tuple[Fault, ...] = ()  # Of the amplifiers and their datagrams
    # Truth file of the cell as it was when the part was touched, where the arm has drifted since; None: as it is now
    touched: Path | None = None

    def _live(self, cell: Cell, truth: Truth, job: Job) -> LiveCell:
        return LiveCell(
            job.machined,
            truth=truth,
            controller=simulate.controller(cell),
            stock=cell.stock(),
            cutter={number: cell.cutter(number) for number in simulate.tools_of(job.path)},
            datum_points_part=cell.datum_points_part if cell.part.measured_with == "robot" else None,
            answer=self.answer,
            own_backlash=self.own_backlash,
            touched=None if self.touched is None else read_truth(self.touched),
        )

    def _instruments(self, cell: Cell, truth: Truth, live: LiveCell, device: ForceDevice | None) -> Instruments:
        laboratory_, table = laboratory(self.seed), cell.tables.sensor
        segment = None if table is None else table.segment
        sensor = force_sensor(truth, self.seed, segment, hose_share=self.hose_share)
        bridges, amplifiers, steps = strains(self, cell, live.plant, laboratory_)
        return Instruments(
            laboratory_,
            sensor,
            device,
            self.tracker_peer,
            tracker_faults=FaultSchedule(self.tracker_faults, self.seed),
            tracker_every_s=1.0 / as_positive("tracker_hz", self.tracker_hz),
            holder=bridges,
            strain=amplifiers,
            strain_steps=steps,
        )

    def _device(self, cell: Cell) -> ForceDevice | None:
        """Open the force sensor that speaks the protocol of the cell file."""
        if self.force_port is None:
            return None
        table = cell.tables.sensor
        start = ForceStart(
            host=self.force_host,
            port=self.force_port,
            http_port=self.force_http_port,
            faults=FaultSchedule(self.force_faults, self.seed),
            values={} if table is None else table.link,
            frame=None if table is None or table.frame is None else table.frame.source(),
            where=str(self.cell),
        )
        return force_device(PROTOCOL if table is None else table.protocol, start)

    def _controller(self, cell: Cell) -> SimulatedController:
        name, file = chosen(self.robot, cell)
        place = ROBOT_LINKS[name].simulated
        if not place:
            raise InputError("this link has no simulated controller", where=str(self.cell), value=name)
        made: SimulatedController = imported(place)(
            ControllerOrder(
                cell=cell,
                file=file,
                scenario=self.scenario,
                seed=self.seed,
                job=program_job(self.program),
                values=values_of(name, cell),
            )
        )
        return made


def run(
    settings: LiveSettings,
    out: str | Path,
    *,
    started: Callable[[ForceDevice | None], None] = lambda _: None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run the cell until its program has ended, its controller has stopped, or the sensor program has gone.

    Writes what ``simulate`` writes, so that ``evaluate`` and ``report`` judge the part.

    Args:
        started: Told the force sensor before the first telegram is sent.

    Returns:
        The summary.

    Raises:
        OutputError: No sensor program answers; nothing is written.
    """
    cell, truth = read_cell(settings.cell), read_truth(settings.truth)
    inputs = inputs_of(settings.original or settings.program, settings.cell)
    simulate.check_same_cell(cell, truth, str(settings.truth))
    job = read_job(settings.program, cell, reading=settings.reading)
    reference = settings.original if settings.original is not None else settings.program
    if settings.original is not None:
        read_job(reference, cell, reading=settings.reading)
    made = settings._controller(cell)
    robot_controller = made.controller
    live = settings._live(cell, truth, job)
    if not robot_controller.guides:
        live.skip_to_contact()
    device = settings._device(cell)
    instruments = settings._instruments(cell, truth, live, device)
    plc = None
    if settings.strain_plc is not None and instruments.strain is not None:
        kind, where = settings.strain_plc
        plc = imported(PLCS[kind].terminals)(cell, instruments.strain, where)
    server = CellServer(
        live,
        robot_controller,
        settings.peer or made.peer,
        instruments,
        made.take_force if settings.own_force else None,
        timing=settings.timing,
    )
    begin = time.perf_counter()
    try:
        with atomic.atomic_folder(out) as staging:
            started(device)
            server.meet()
            why = server.run(progress=progress)
            record = live.record()
            machined = {"machined_sha256": digest(settings.program)}
            summary = {
                "job": "simulate",
                "program": settings.program.name,
                "original": Path(reference).name,
                "cell": cell.name,
                "truth": truth.name,
                "seed": truth.seed,
                "inputs": inputs | machined,
                "machining": simulate.figures(record),
                "online": {"cycles": server.cycles, "late_answers": robot_controller.late, "ended": why},
                "seconds": round(time.perf_counter() - begin, 3),
                "counterflex": __version__,
            }
            simulate.keep_inputs(cell, settings.program, reference, staging, settings.reading)
            write_truth(staging / simulate.TRUTH, truth)
            about = {key: summary[key] for key in ("program", "cell", "seed", "counterflex")}
            write_run(staging / simulate.RUN, record, about)
            record.stock.save(staging / simulate.SURFACE)
            write_folder_summary(staging, summary)
    finally:
        server.close()
        if plc is not None:
            plc.close()
    return summary


def strains(
    settings: LiveSettings, cell: Cell, plant: Plant, laboratory_: Laboratory
) -> tuple[StrainStream | None, StrainSender | None, int]:
    """Bridges of the holder as they truly are, their amplifiers, and integration steps for each reading.

    Raises:
        InputError: The cell has no holder, or no integration steps fit between readings of this rate.
    """
    if settings.strain_peer is None and settings.strain_plc is None:
        return None, None, 1
    holder = strain_holder(cell.tables.holder)
    if holder is None or not holder.segment:
        raise InputError(
            "strains are to be sent, but the cell has no instrumented holder in its chain",
            where=str(cell.path),
            value="strain.address",
            hint="Add a table [holder] with segment, the body whose frame is the holder's",
        )
    steps = round(1.0 / (settings.strain_hz * plant.step_s))
    if steps < 1 or abs(steps * plant.step_s * settings.strain_hz - 1.0) > 1e-9:
        raise InputError(
            "rate of the simulated strain amplifiers", value=settings.strain_hz, limit="2000, 1000, 500, 250 or 200 Hz"
        )
    places = np.array([(*g.p_holder_gauge, g.angle_rad, g.factor) for g in holder.gauges])
    true = instrumented_holder(places, settings.seed)
    rng = laboratory_.noise("live strain")
    stream = StrainStream(true, holder.segment, plant, rng, steps * plant.step_s, settings.strain_warm_k)
    faults = FaultSchedule(settings.strain_faults, settings.seed)
    return stream, StrainSender(settings.strain_peer, len(places), faults), steps
