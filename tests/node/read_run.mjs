// Reads a run file as Foxglove and Lichtblick do, and compares every field with what was published.
//
// Usage: node read_run.mjs RUN.mcap EXPECTED.json
//
// The types are learnt from the file alone. Floating-point numbers are compared by their bits.

import { open, readFile } from "node:fs/promises";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";
import { comparable, isNan, valueAt } from "./fields.mjs";

const [run, expectedFile] = process.argv.slice(2);
// Numbers that a double does not hold come as texts.
const text = (await readFile(expectedFile, "utf8")).replace(/(?<=[[,:])-?\d{16,}(?=[,\]}])/g, '"$&"');
const expected = JSON.parse(text);

function fail(sentence) {
  console.error(sentence);
  process.exit(1);
}

const file = await open(run);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await file.read(buffer, 0, Number(length), Number(offset));
    return buffer;
  },
};
const decompressHandlers = { zstd: (packed, size) => decompress(packed, new Uint8Array(Number(size))) };
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
if (reader.header.profile !== "ros2") {
  fail("the profile of the file is not ros2");
}

const decoders = new Map();
const seen = new Map();
let fields = 0;
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  const wanted = expected[channel.topic];
  if (!wanted) {
    continue; // what the recorder says about itself
  }
  const schema = reader.schemasById.get(channel.schemaId);
  if (!decoders.has(channel.schemaId)) {
    const definition = new TextDecoder().decode(schema.data);
    decoders.set(channel.schemaId, new MessageReader(parse(definition, { ros2: true })));
  }
  const number = seen.get(channel.topic) ?? 0;
  seen.set(channel.topic, number + 1);
  const where = `${channel.topic} sample ${number}`;
  const sample = wanted.samples[number];
  if (!sample || schema.name !== wanted.schema) {
    fail(`${where}: type ${schema.name}, not ${wanted.schema}, or one sample too many`);
  }
  for (const [name, time] of [["log_time", message.logTime], ["publish_time", message.publishTime]]) {
    if (sample[name] !== undefined && BigInt(sample[name]) !== time) {
      fail(`${where}: ${name} ${time}, not ${sample[name]}`);
    }
  }
  const decoded = decoders.get(channel.schemaId).readMessage(message.data);
  for (const [path, kind, values] of sample.fields) {
    const found = comparable(kind, valueAt(decoded, path));
    const same = (value, at) => BigInt(value) === found[at] || (isNan(kind, BigInt(value)) && isNan(kind, found[at]));
    if (found.length !== values.length || !values.every(same)) {
      const at = values.findIndex((value, at) => !same(value, at));
      const difference = found.length !== values.length ? `has ${found.length} values, not ${values.length}`
        : `differs first in value ${at} of ${values.length}: ${found[at]}, not ${values[at]}`;
      fail(`${where}: ${path} ${difference}`);
    }
    fields += 1;
  }
}
for (const [topic, wanted] of Object.entries(expected)) {
  if (seen.get(topic) !== wanted.samples.length) {
    fail(`${topic} has ${seen.get(topic) ?? 0} samples, ${wanted.samples.length} were published`);
  }
}
console.log(`@mcap/core: ${[...seen.values()].reduce((a, b) => a + b, 0)} samples of ${seen.size} channels, ${fields} fields equal`);
