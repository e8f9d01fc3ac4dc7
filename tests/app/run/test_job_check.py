"""Program and plan belong together: what does not is refused, and nothing is compensated twice."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.app.compensation import compensate as job
from counterflex.app.compensation.compensate import compensate
from counterflex.app.run import session as online_session
from counterflex.app.run.job_check import check_job
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.plan_file import read_plan
from counterflex.integrations.kuka.language.rsi import with_correction
from counterflex.integrations.kuka.language.rsi_switching import RsiSwitching
from counterflex.plan.plan import job_hash
from counterflex.programs.compensated import mark, marks

ProgramFile = Callable[..., Path]
RSI = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
OTHER = "0123456789abcdef"


@pytest.fixture
def made(small: Path, program: ProgramFile, tmp_path: Path) -> Path:
    """A folder with a compensated program and its plan."""
    job.run(program(), small, tmp_path / "made", report=False, predict=False)
    return tmp_path / "made"


def compensated(made: Path) -> Path:
    return next(made.glob("*.ngc"))


def test_program_and_plan_of_a_job_carry_one_hash(small: Path, program: ProgramFile, made: Path) -> None:
    plan, about = read_plan(made / "plan.parquet")
    assert marks(compensated(made).read_text(encoding="latin-1")) == (about["job_hash"],)
    check_job(compensated(made), (plan, about), compensated=True)
    for language in ("krl", "rapid"):
        found = compensate(program(), read_cell(small), language=language, predict=False)
        main = next(text for name, text in found.files.items() if name.endswith((".src", ".mod")))
        assert marks(main) == (job_hash(found.plan),)
        if language == "krl":
            switching = RsiSwitching("counterflex.rsi", (), 4, 2, 1, 3, 4, 60.0, 3.0)
            assert marks(with_correction(main, switching, "main.src")) == marks(main)
        assert job_hash(found.plan) == found.summary["job_hash"]


def test_another_correction_another_point_or_another_tool_is_another_job(made: Path) -> None:
    plan, _ = read_plan(made / "plan.parquet")
    nudged = plan.correction_part.copy()
    nudged[len(nudged) // 2, 1] += 1e-9
    moved = plan.path.p_part_tcp.copy()
    moved[0, 0] += 1e-9
    others = [
        dataclasses.replace(plan, correction_part=nudged),
        dataclasses.replace(plan, rotvec_part=plan.rotvec_part + 1e-9),
        dataclasses.replace(plan, path=dataclasses.replace(plan.path, p_part_tcp=moved)),
        dataclasses.replace(plan, path=dataclasses.replace(plan.path, tool=plan.path.tool + 1)),
    ]
    assert len({job_hash(plan), *map(job_hash, others)}) == 5
    assert job_hash(dataclasses.replace(plan, q=plan.q + 1.0)) == job_hash(plan)  # not commanded


def test_what_does_not_belong_together_is_refused(program: ProgramFile, made: Path, tmp_path: Path) -> None:
    planned = read_plan(made / "plan.parquet")
    own, original = compensated(made), program()
    strange = tmp_path / "strange.ngc"
    strange.write_text(own.read_text(encoding="latin-1").replace(planned[1]["job_hash"], OTHER), encoding="latin-1")
    both = tmp_path / "both.ngc"
    both.write_text(f"({mark(OTHER)})\n" + own.read_text(encoding="latin-1"), encoding="latin-1")
    check_job(original, planned, compensated=False)
    check_job(original, None, compensated=True)
    for file in (strange, both):
        with pytest.raises(InputError, match="different jobs") as refused:
            check_job(file, planned, compensated=True)
        assert OTHER in str(refused.value)
        assert planned[1]["job_hash"] in str(refused.value)
    with pytest.raises(InputError, match="not a compensated one"):
        check_job(original, planned, compensated=True)
    for plan, said in ((planned, False), (None, False), (None, True)):
        with pytest.raises(InputError, match="compensated twice"):
            check_job(own, plan, compensated=said)
    with pytest.raises(FileFormatError, match="no such file"):
        check_job(tmp_path / "nowhere.ngc", planned, compensated=True)
    with pytest.raises(FileFormatError, match="which program"):
        check_job(own, (planned[0], {}), compensated=True)


def test_a_plan_that_changes_nothing_leaves_the_program_as_it_was(program: ProgramFile, made: Path) -> None:
    plan, about = read_plan(made / "plan.parquet")
    still = dataclasses.replace(plan, correction_part=np.zeros_like(plan.correction_part))
    check_job(program(), (still, about), compensated=True)


def test_a_compensated_program_is_not_compensated_again(small: Path, made: Path) -> None:
    with pytest.raises(InputError, match="compensated twice"):
        compensate(compensated(made), read_cell(small), predict=False)


def test_a_run_is_refused_before_anything_is_opened(small: Path, made: Path, tmp_path: Path) -> None:
    cell = tmp_path / "online.toml"
    cell.write_text(small.read_text(encoding="utf-8") + '\n[online]\nforce = "fused"\n', encoding="utf-8")
    settings = online_session.RunSettings(cell, ("rsi", RSI), made / "plan.parquet", port=0, program=compensated(made))
    session = online_session.open_session(settings)
    session.link.close()
    with pytest.raises(InputError, match="compensated twice"):
        online_session.open_session(dataclasses.replace(settings, compensated=False))
    with pytest.raises(InputError, match="compensated twice"):
        online_session.open_session(dataclasses.replace(settings, plan=None))


@pytest.mark.parametrize("text", ["", "0123", OTHER.upper(), OTHER + "0", "(" + OTHER[1:]])
def test_a_hash_that_is_none_is_not_written(text: str) -> None:
    with pytest.raises(InputError):
        mark(text)
    assert marks(f"(counterflex job {text})") == ()
