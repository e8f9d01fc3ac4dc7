"""The robots of the catalogue, listed; nothing else is loaded for it."""

from __future__ import annotations

from typing import Any

from counterflex.robot.model import catalog


def robots() -> list[dict[str, Any]]:
    """One row per catalogue robot: name, model, reach, payload, and the status of each group of numbers."""
    rows = []
    for name in catalog.names():
        entry = catalog.entry(name)
        rows.append(
            {
                "name": name,
                "model": f"{entry.manufacturer} {entry.model}",
                "reach_mm": entry.reach_mm,
                "payload_kg": entry.payload_kg,
                "status": {group: source.status for group, source in entry.sources.items()},
                "source": {group: source.source for group, source in entry.sources.items()},
            }
        )
    return rows
