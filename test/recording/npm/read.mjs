// SPDX-License-Identifier: Apache-2.0
// Prints, as one JSON object, what the npm readers find in an MCAP file: counts by topic and the last joint state.
import { open } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { decompress } from "fzstd";

const handle = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await handle.stat()).size),
  read: async (offset, length) => {
    const data = new Uint8Array(Number(length));
    await handle.read(data, 0, data.length, Number(offset));
    return data;
  },
};
const decompressHandlers = { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) };
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
const counts = {};
const readers = new Map();
const last = {};
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  if (!readers.has(channel.schemaId)) {
    const schema = reader.schemasById.get(channel.schemaId);
    readers.set(channel.schemaId, new MessageReader(parse(new TextDecoder().decode(schema.data), { ros2: true })));
  }
  counts[channel.topic] = (counts[channel.topic] ?? 0) + 1;
  last[channel.topic] = readers.get(channel.schemaId).readMessage(message.data);
}
const plain = (key, value) => (ArrayBuffer.isView(value) ? Array.from(value) : typeof value === "bigint" ? Number(value) : value);
console.log(JSON.stringify({ profile: reader.header.profile, counts, last }, plain));
await handle.close();
