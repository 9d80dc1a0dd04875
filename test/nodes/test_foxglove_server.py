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

from mech_twin.messages.topics import DIAGNOSTICS

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


MECH_TWIN = (sys.executable, "-m", "mech_twin")


@contextmanager
def ended(*words: str, **streams):
    """Yield a command that runs, and end it as a user does."""

    process = subprocess.Popen([*MECH_TWIN, *words], text=True, **streams)
    try:
        yield process
    finally:
        process.terminate()
        code = process.wait(LIMIT_S)
    assert (words[0], code) == (words[0], 0)


def machine_runs():
    """Return the context of a machine that runs."""

    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return ended("run", CRANK, "--view", "none", "--no-record", **quiet)


@contextmanager
def server_runs(*words: str):
    """Yield the port of a server."""

    with ended("foxglove", CRANK, "--port", "0", *words, stderr=subprocess.PIPE) as server, server.stderr:
        line = next(line for line in server.stderr if "ws://" in line)
        yield int(line.partition("127.0.0.1:")[2].split(" ")[0])


@contextmanager
def served(*words: str):
    """Yield the port of the server of a machine that runs."""

    with machine_runs(), server_runs(*words) as port:
        yield port


@pytest.mark.slow
def test_a_server_outlives_a_question_to_a_machine_that_is_not_there_yet():
    async def asked_early(client):
        await client._socket.send_json({"op": "getParameters", "parameterNames": [], "id": "get"})
        status = await client.hear(lambda told: told["op"] == "status" and told["level"] > 0)
        assert "does the machine run?" in status["message"]
        assert await client.values() == {}

    async def asked_later(client):
        assert await client.look_at(f"/{CRANK}/joint_states")
        assert (await client.values("drive.speed_rpm"))["drive.speed_rpm"] > 0.0

    with server_runs("--commands") as port:
        with_client(port, asked_early)
        with machine_runs():
            with_client(port, asked_later)


@pytest.mark.slow
def test_a_server_tells_that_no_machine_runs():
    with ended("foxglove", "nonsense", "--port", "0", stderr=subprocess.PIPE) as server, server.stderr:
        lines = [server.stderr.readline() for _ in range(2)]
    assert "no node in /nonsense yet; does the machine run?" in lines[1]


@pytest.mark.slow
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

    async def diagnosed(client):  # which the layout of the machine shows
        return deserialize_message(await client.look_at(DIAGNOSTICS.name), DIAGNOSTICS.type).status[0].hardware_id

    with served("--commands") as port:
        with_client(port, talk)
        assert with_client(port, diagnosed) == CRANK


@pytest.mark.slow
def test_a_client_that_comes_later_sees_the_description_that_another_shows_already():
    async def talk(first):
        held = await first.look_at(f"/{CRANK}/description")
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"ws://127.0.0.1:{port}", protocols=[SUBPROTOCOL], max_msg_size=0) as socket,
        ):
            assert await FoxgloveClient(socket).look_at(f"/{CRANK}/description") == held

    with served() as port:
        with_client(port, talk)


@pytest.mark.slow
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


@pytest.mark.slow
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
