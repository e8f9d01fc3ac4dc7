"""Code that a result rests on: what is imported counts, what only shows or only explains does not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from counterflex.app.long_jobs import code_used
from counterflex.app.long_jobs.code_used import code_of, reached

FILES = {
    "__init__.py": "",
    "app/__init__.py": "",
    "app/job.py": "from counterflex.robot import arm\ndef run():\n    from counterflex.app.show import page\n",
    "app/show.py": "from counterflex.report.page import page\n",
    "report/__init__.py": "",
    "report/page.py": "def page(x):\n    return x\n",
    "robot/__init__.py": "",
    "robot/arm.py": '"""An arm."""\n\nL = 1.0  # m\n',
    "robot/unused.py": "X = 1\n",
    "robot/data/kr.toml": "length_m = 2.0\n",
    "runtime/__init__.py": "",
    "runtime/step.py": "import counterflex.robot.arm\n",
}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(code_used, "_ROOT", tmp_path)
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    for one in (code_used.code_of, code_used._shows, code_used._file, code_used._tree):
        one.cache_clear()


def changed(package: Path, name: str, text: str) -> dict[str, str]:
    (package / name).write_text(text, encoding="utf-8")
    forget()
    return code_of("counterflex.app.job")


def test_imports_are_followed_but_not_into_what_shows(package: Path) -> None:
    assert package.is_dir()
    assert reached("counterflex.app.job") == {"counterflex.app.job", "counterflex.robot", "counterflex.robot.arm"}
    assert reached("counterflex.runtime.step") == {"counterflex.runtime.step", "counterflex.robot.arm"}
    assert reached("counterflex.runtime.step", without=("robot",)) == {"counterflex.runtime.step"}


def test_only_the_room_that_changed_has_another_hash(package: Path) -> None:
    before = code_of("counterflex.app.job")
    assert set(before) == {"app", "robot"}
    for name, text in (
        ("robot/arm.py", '"""A longer text."""\n\n# and why\nL = 1.0\n'),
        ("robot/unused.py", "X = 2\n"),
        ("report/page.py", "def page(x):\n    return 2 * x\n"),
        ("robot/data/kr.toml", "# from the catalogue\nlength_m = 2.0\n"),
    ):
        assert changed(package, name, text) == before
    other = changed(package, "robot/arm.py", "L = 1.5\n")
    assert other["app"] == before["app"]
    assert other["robot"] != before["robot"]
    assert changed(package, "robot/data/kr.toml", "length_m = 2.1\n")["robot"] != other["robot"]


def test_a_plan_does_not_rest_on_the_loop() -> None:
    planning = code_of("counterflex.app.compensation.compensate", without=("runtime", "protocols"))
    milling = code_of("counterflex.validation.reproduce.closed_loop")
    assert {"plan", "cutting", "robot", "geometry", "core"} <= set(planning)
    assert not {"runtime", "protocols", "twin", "report", "cli"} & set(planning)
    assert {"runtime", "protocols", "twin"} <= set(milling)
    assert planning["geometry"] == milling["geometry"]
