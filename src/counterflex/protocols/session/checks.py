"""Conditions that must hold before the correction may be armed, and while it acts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SessionChecks:
    """Conditions that must hold before the correction may be armed."""

    settle_cycles: int = 60  # good telegrams in a row
    force_n: float = 15.0  # largest force that the sensor may show after its weight is taken off, without a cut (R17)
    moment_nm: float = 5.0  # largest moment
    tare: bool = True  # take what then remains as zero, over 0.2 s; what is too much is tried again until it is not
    # a log that is lost while the correction acts is a hold; else it is told, and goes on. It is never armed without
    # one
    hold_without_log: bool = False
    # the loop is armed, and the correction acts, only while an operator panel says that it lives; else none is needed,
    # and one that dies is told
    hold_without_panel: bool = False
    # number of the job that the robot program must say it is of, where it says one (job_number); 0: none, the program
    # is not a compensated one. None: not tested
    job: int | None = None
    # the process that started the loop says many times a second that it lives; silent for so long it counts as lost.
    # Not tested where nobody has ever said so, and None: never, a robot that waits for every answer has time. A process
    # that has died is seen by the operating system, see Living
    run_silent_s: float | None = 0.08
