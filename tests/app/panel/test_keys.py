"""Keys of the operator's page: every way to press S or Escape ramps out."""

from __future__ import annotations

import pytest

from counterflex.app.panel.page import IGNORED_IN, action_of


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("s", "KeyS"),
        ("S", "KeyS"),  # Caps Lock or Shift
        ("Escape", "Escape"),
        ("Escape", "CapsLock"),  # Caps Lock that the system has made an Escape
        ("ы", "KeyS"),  # a Russian layout
        ("s", "KeyM"),  # a layout that has S elsewhere
        ("o", "KeyS"),  # Dvorak: who looks for the place of S gets a stop, too
    ],
)
@pytest.mark.parametrize("shortcut", [False, True])
def test_every_reading_of_a_key_that_may_be_a_stop_is_one(name: str, code: str, shortcut: bool) -> None:
    assert action_of(name, code, shortcut=shortcut) == "stop"


@pytest.mark.parametrize(
    ("name", "code", "action"),
    [
        ("r", "KeyR", "reset"),
        ("R", "KeyR", "reset"),
        ("a", "KeyA", "arm"),
        ("A", "KeyQ", "arm"),  # AZERTY: by what is written on the key
        ("q", "KeyA", None),
        ("ф", "KeyA", "arm"),  # a Russian layout: by its place
        ("x", "KeyX", None),
        ("Enter", "Enter", None),
        ("Shift", "ShiftLeft", None),
    ],
)
def test_arming_and_acknowledging_go_by_the_letter(name: str, code: str, action: str | None) -> None:
    assert action_of(name, code) == action
    assert action_of(name, code, shortcut=True) is None


def test_a_button_takes_no_key_away() -> None:
    assert "button" not in IGNORED_IN
    assert set(IGNORED_IN) == {"input", "textarea"}
