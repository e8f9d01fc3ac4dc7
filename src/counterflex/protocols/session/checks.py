"""Conditions that must hold before the correction may be armed, and while it acts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SessionChecks:
    """Conditions that must hold before the correction may be armed.

    Attributes:
        settle_cycles: Good telegrams in a row.
        force_n: Largest force that the sensor may show after its weight is taken off, without a cut (R17).
        moment_nm: Largest moment.
        tare: Take what then remains as zero, over 0.2 s; what is too much is tried again until it is not.
        hold_without_log: A log that is lost while the correction acts is a hold; else it is told, and goes on. It is
            never armed without one.
        hold_without_panel: The loop is armed, and the correction acts, only while an operator panel says that it lives;
            else none is needed, and one that dies is told.
        job: Number of the job that the robot program must say it is of, where it says one
            (:func:`counterflex.programs.compensated.job_number`); 0: none, the program is not a compensated one.
            None: not tested.
        run_silent_s: The process that started the loop says many times a second that it lives; silent for so long it
            counts as lost. Not tested where nobody has ever said so, and None: never, a robot that waits for every
            answer has time. A process that has died is seen by the operating system, see
            :class:`counterflex.protocols.processes.living.Living`.
    """

    settle_cycles: int = 60
    force_n: float = 15.0
    moment_nm: float = 5.0
    tare: bool = True
    hold_without_log: bool = False
    hold_without_panel: bool = False
    job: int | None = None
    run_silent_s: float | None = 0.08
