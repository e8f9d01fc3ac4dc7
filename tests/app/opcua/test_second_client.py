"""The server beside a real loop, read by a client of another code base: node-opcua-client.

Skipped where Node.js or the library is missing; docs/opcua.md says how to have it. NODE_PATH names the folder.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.protocols.processes.control_array import Request
from counterflex_lab.faults.demonstration import Q
from loop_that_runs import Run
from opcua_server import PASSWORD, ServerProcess, users

pytest.importorskip("asyncua", reason="the extra opcua is not installed")
CLIENT = Path(__file__).with_name("second_client.cjs")


def _node() -> str:
    """Node.js with the library."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node.js is not installed")
    found = subprocess.run([node, "-e", "require.resolve('node-opcua-client')"], capture_output=True, check=False)
    if found.returncode:
        pytest.skip("node-opcua-client is not installed where NODE_PATH looks")
    return node


def test_another_code_base_reads_browses_subscribes_and_is_refused(tmp_path: Path) -> None:
    node = _node()
    (tmp_path / "run").mkdir()
    run = Run(tmp_path / "run")
    server = ServerProcess(run.folder, "--users", users(tmp_path))
    run.want = True
    run.rig.control[Request.ARM] = 1
    environment = os.environ | {"HOME": str(tmp_path / "home")}  # where the library keeps keys of its own
    words = [node, str(CLIENT), server.address, "ben", PASSWORD]
    client = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        assert client.stdout is not None
        assert client.stderr is not None
        line = client.stdout.readline()
        while line and line.strip() != "subscribed":
            line = client.stdout.readline()
        assert line, client.stderr.read()
        run.rig.control[Request.STOP] = 1
        rest, errors = client.communicate()
        assert client.returncode == 0, errors
        _judge(json.loads(rest.splitlines()[-1]))
    finally:
        client.kill()
        server.kill()
        run.close()


def _judge(found: dict[str, Any]) -> None:
    assert found["endpoints"] == ["http://opcfoundation.org/UA/SecurityPolicy#None"]
    assert found["state"] == {"status": "Good", "value": "ACTIVE", "type": "String"}
    assert found["force"]["type"] == "Double"
    assert np.allclose([axis["value"] for axis in found["axes"]], np.degrees(Q), atol=1e-3)  # four digits on the wire
    assert found["tracker"]["status"] == "BadNotConnected"
    assert found["unit"]["id"] == int.from_bytes(b"NEW", "big")
    assert {"Run", "State", "Correction", "Deviation", "Force", "Path", "Link", "Alarms", "Acknowledge"} <= set(
        found["below"]
    )
    assert found["write"] == "BadUserAccessDenied"
    assert found["call"] == "BadUserAccessDenied"
    assert found["changes"][0] == "ACTIVE"
    assert found["event"]["text"].endswith(": operator")
    assert found["event"]["severity"] == 700
    assert found["incident"]["value"] is True
