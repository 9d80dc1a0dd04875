# SPDX-License-Identifier: Apache-2.0
"""A Foxglove client sees the topics of a running machine, and commands it where that is allowed."""

from __future__ import annotations

import asyncio
import json
import struct
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import aiohttp
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

pytest.importorskip("foxglove")
CRANK, LIMIT_S = "vibration_crank", 30.0
SUBPROTOCOL = "foxglove.sdk.v1"
NPM = Path(__file__).parents[1] / "recording" / "npm"
pytestmark = pytest.mark.usefixtures("ros_domain")


class FoxgloveClient:
    """The protocol's client side, as far as it is used here."""

    def __init__(self, socket) -> None:
        self._socket = socket
        self.channels: dict[str, dict] = {}
        self.services: dict[str, dict] = {}

    async def hear(self, wanted):
        """Return the first message for which something holds; keep what is advertised."""
        async with asyncio.timeout(LIMIT_S):
            while True:
                message = await self._socket.receive()
                if message.type is aiohttp.WSMsgType.TEXT:
                    told = json.loads(message.data)
                    self.channels |= {each["topic"]: each for each in told.get("channels", [])}
                    self.services |= {each["name"]: each for each in told.get("services", [])}
                else:
                    assert message.type is aiohttp.WSMsgType.BINARY, message
                    told = {"op": message.data[0], "raw": message.data[1:]}
                if wanted(told):
                    return told

    async def offered(self, topic: str) -> dict:
        while topic not in self.channels:
            await self.hear(lambda told: told["op"] == "advertise")
        return self.channels[topic]

    async def look_at(self, topic: str) -> bytes:
        """Return a message of a topic."""
        channel = await self.offered(topic)
        for number in range(7, 20):
            # the SDK tells of a channel before it takes a subscription to it
            asked = {"op": "subscribe", "subscriptions": [{"id": number, "channelId": channel["id"]}]}
            await self._socket.send_json(asked)
            told = await self.hear(lambda told: told["op"] in (1, "status"))
            if told["op"] == 1:
                return told["raw"][12:]  # subscription, time
            await asyncio.sleep(0.5)
        raise AssertionError(told)

    async def call(self, name: str) -> dict:
        while name not in self.services:
            await self.hear(lambda told: told["op"] == "advertiseServices")
        head = struct.pack("<BIII", 2, self.services[name]["id"], 11, 4)
        await self._socket.send_bytes(head + b"json" + b"{}")
        told = await self.hear(lambda told: told["op"] in (3, "serviceCallFailure"))
        assert told["op"] == 3, told
        length = struct.unpack_from("<I", told["raw"], 8)[0]
        return json.loads(told["raw"][12 + length :])

    async def values(self, *names: str) -> dict:
        await self._socket.send_json({"op": "getParameters", "parameterNames": list(names), "id": "get"})
        told = await self.hear(lambda told: told["op"] == "parameterValues" and told.get("id") == "get")
        return {each["name"]: each["value"] for each in told["parameters"]}

    async def change(self, name: str, value: float) -> dict:
        changed = {"name": name, "value": value, "type": "float64"}
        await self._socket.send_json({"op": "setParameters", "parameters": [changed], "id": "set"})
        told = await self.hear(lambda told: told["op"] == "parameterValues" and told.get("id") == "set")
        return {each["name"]: each["value"] for each in told["parameters"]}


def with_client(port: int, talk):
    """Return what a client brings back."""

    async def connected():
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"ws://127.0.0.1:{port}", protocols=[SUBPROTOCOL], max_msg_size=0) as socket,
        ):
            return await talk(FoxgloveClient(socket))

    return asyncio.run(connected())


@contextmanager
def served(*words: str):
    """Yield the port of the server of a machine that runs, started as a user does."""

    run = [sys.executable, "-m", "mech_twin"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    machine = subprocess.Popen([*run, "run", CRANK, "--view", "none", "--no-record"], **quiet)
    server = subprocess.Popen([*run, "foxglove", CRANK, "--port", "0", *words], stderr=subprocess.PIPE, text=True)
    try:
        line = next(line for line in server.stderr if "ws://" in line)
        yield int(line.partition("127.0.0.1:")[2].split(" ")[0])
    finally:
        for process in (server, machine):
            process.terminate()
        codes = [process.wait(30) for process in (server, machine)]
        server.stderr.close()
    assert codes == [0, 0]


def test_a_client_sees_topics_parameters_and_services_and_changes_the_machine():
    async def talk(client):
        raw = await client.look_at(f"/{CRANK}/joint_states")
        channel = client.channels[f"/{CRANK}/joint_states"]
        assert (channel["encoding"], channel["schemaName"]) == ("cdr", "sensor_msgs/msg/JointState")
        assert "float64[] position" in channel["schema"]
        joints = deserialize_message(raw, JointState)
        assert "crank" in list(joints.name)

        assert (await client.values("drive.speed_rpm"))["drive.speed_rpm"] > 0.0
        assert await client.change("drive.speed_rpm", 250.0) == {"drive.speed_rpm": 250.0}
        assert await client.change("drive.speed_rpm", 0.0) == {"drive.speed_rpm": 250.0}, (
            "a refused value is not in force"
        )

        assert await client.call(f"/{CRANK}/step") == {
            "success": False,
            "message": "step: refused: the run is not paused: call pause with data: true first",
        }
        assert (await client.call(f"/{CRANK}/pause"))["success"]
        assert (await client.call(f"/{CRANK}/step"))["success"]
        assert (await client.call(f"/{CRANK}/go-on"))["success"]
        assert "supply off" in (await client.call(f"/{CRANK}/stop"))["message"]

    with served("--commands") as port:
        with_client(port, talk)


def test_foxgloves_own_client_sees_a_topic_a_parameter_and_a_service():
    if not (NPM / "node_modules").is_dir():
        pytest.skip("the JavaScript client is not set up: make test does it where npm is found")
    with served("--commands") as port:
        words = [str(port), f"/{CRANK}/joint_states", "drive.speed_rpm", f"/{CRANK}/step"]
        command = ["node", "foxglove.mjs", *words]
        done = subprocess.run(command, cwd=NPM, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert "crank" in seen["message"]["name"]
    assert seen["parameters"][0]["value"] > 0.0
    assert "the run is not paused" in seen["answer"]["message"]


def test_without_commands_a_client_watches_and_changes_nothing():
    async def talk(client):
        told = await client.hear(lambda told: told["op"] == "serverInfo")
        assert not {"parameters", "services"} & set(told["capabilities"])
        assert await client.look_at(f"/{CRANK}/joint_states")
        await client._socket.send_json(
            {"op": "setParameters", "parameters": [{"name": "drive.speed_rpm", "value": 250.0}], "id": "set"}
        )
        await client.hear(lambda told: told["op"] == "status" and told["level"] > 0)
        assert client.services == {}

    with served() as port:
        with_client(port, talk)
