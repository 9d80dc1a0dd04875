// SPDX-License-Identifier: Apache-2.0
// Foxglove's own client at the server of a machine: prints what it sees of a topic, its parameters and a service.
// Usage: node foxglove.mjs PORT TOPIC PARAMETER SERVICE
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import protocol from "@foxglove/ws-protocol";
import { WebSocket } from "ws";

const [port, topic, parameter, service] = process.argv.slice(2);
const client = new protocol.FoxgloveClient({ ws: new WebSocket(`ws://127.0.0.1:${port}`, ["foxglove.sdk.v1"]) });
const plain = (key, value) => (ArrayBuffer.isView(value) ? Array.from(value) : typeof value === "bigint" ? Number(value) : value);
const seen = {};
let reader, subscribed, found, asked;

// the machine may still be starting: its nodes are asked once it runs
function ask() {
  if (asked || !found || !("message" in seen)) return;
  asked = true;
  client.getParameters([parameter], "get");
  client.sendServiceCallRequest({ serviceId: found.id, callId: 1, encoding: "json", data: new TextEncoder().encode("{}") });
}

function told(part) {
  Object.assign(seen, part);
  if ("message" in seen && "parameters" in seen && "answer" in seen) {
    console.log(JSON.stringify(seen, plain));
    process.exit(0);
  }
}

// the server tells of a channel before it takes a subscription to it
function look(channel) {
  if ("message" in seen) return;
  if (subscribed !== undefined) client.unsubscribe(subscribed);
  subscribed = client.subscribe(channel.id);
  setTimeout(() => look(channel), 500);
}

client.on("error", (error) => { console.error(String(error)); process.exit(1); });
client.on("parameterValues", ({ parameters }) => told({ parameters }));
client.on("advertise", (channels) => {
  const channel = channels.find((each) => each.topic === topic);
  if (!channel) return;
  reader = new MessageReader(parse(channel.schema, { ros2: true }));
  look(channel);
});
client.on("message", ({ data }) => {
  told({ message: reader.readMessage(data) });
  ask();
});
client.on("advertiseServices", (services) => { found = services.find((each) => each.name === service) ?? found; ask(); });
client.on("serviceCallResponse", ({ data }) => told({ answer: JSON.parse(new TextDecoder().decode(data)) }));
