// Looks at a robot as Foxglove and Lichtblick do, over their WebSocket protocol, and compares every field with what was published.
//
// Usage: node read_live.mjs ws://ADDRESS:PORT EXPECTED.json
//
// The file has, for each topic that is to be looked at: the type name, the definition, how many samples are wanted, and the fields of each
// sample by the value of `key` in it. Samples may come in any number and be thinned, but each has to be one that was published, field by
// field. A second client asks for everything and never reads: that must not disturb others. Says "looking" when it has subscribed, and one
// sentence at the end.

import { readFile } from "node:fs/promises";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import WebSocket from "ws";
import { comparable, isNan, valueAt } from "./fields.mjs";

const [address, expectedFile] = process.argv.slice(2);
const PROTOCOLS = ["foxglove.sdk.v1"];
const MESSAGE_DATA = 1;
// Numbers that a double does not hold come as texts.
const text = (await readFile(expectedFile, "utf8")).replace(/(?<=[[,:])-?\d{16,}(?=[,\]}])/g, '"$&"');
const expected = JSON.parse(text);

function fail(sentence) {
  console.error(sentence);
  process.exit(1);
}

function connect(onText, onData) {
  const socket = new WebSocket(address, PROTOCOLS);
  socket.binaryType = "nodebuffer";
  socket.on("error", (error) => fail(`no connection: ${error.message}`));
  socket.on("message", (data, isBinary) => (isBinary ? onData?.(data) : onText?.(JSON.parse(data.toString()), socket)));
  return socket;
}

const channels = new Map();
const subscriptions = new Map();
const seen = new Map();
let fields = 0;

function advertised(message, socket) {
  if (message.op !== "advertise") {
    return;
  }
  for (const channel of message.channels) {
    const wanted = expected[channel.topic];
    if (!wanted) {
      continue;
    }
    if (channel.encoding !== "cdr" || channel.schemaEncoding !== "ros2msg") {
      fail(`${channel.topic}: encoding ${channel.encoding}, definition in ${channel.schemaEncoding}`);
    }
    if (channel.schemaName !== wanted.type || channel.schema !== wanted.definition) {
      fail(`${channel.topic}: type ${channel.schemaName}, definition\n${channel.schema}`);
    }
    const reader = new MessageReader(parse(channel.schema, { ros2: true }));
    channels.set(channel.topic, channel.id);
    subscriptions.set(channel.id, { topic: channel.topic, reader, wanted });
    socket.send(JSON.stringify({ op: "subscribe", subscriptions: [{ id: channel.id, channelId: channel.id }] }));
  }
  if (channels.size === Object.keys(expected).length) {
    console.log("looking");
  }
}

function arrived(data) {
  if (data[0] !== MESSAGE_DATA) {
    return;
  }
  const { topic, reader, wanted } = subscriptions.get(data.readUInt32LE(1));
  const loggedNs = data.readBigUInt64LE(5);
  const message = reader.readMessage(data.subarray(13));
  const key = wanted.key === null ? "" : String(valueAt(message, wanted.key));
  const sample = wanted.samples[key];
  if (!sample) {
    fail(`${topic}: ${wanted.key} = ${key} was never published`);
  }
  for (const [path, kind, values] of sample) {
    const found = comparable(kind, valueAt(message, path));
    const same = (value, at) => BigInt(value) === found[at] || (isNan(kind, BigInt(value)) && isNan(kind, found[at]));
    if (found.length !== values.length || !values.every(same)) {
      fail(`${topic} ${key}: ${path} is ${found}, not ${values}`);
    }
    fields += 1;
  }
  // the wall clock of this machine, give or take an hour: a test can stand still, but not that long
  if (Math.abs(Number(loggedNs / 1_000_000n) - Date.now()) > 3_600_000) {
    fail(`${topic} ${key}: logged at ${loggedNs} ns`);
  }
  seen.set(topic, (seen.get(topic) ?? 0) + 1);
  if ([...Object.entries(expected)].every(([name, { enough }]) => (seen.get(name) ?? 0) >= enough)) {
    const counts = Object.fromEntries(seen);
    console.log(`${fields} fields of ${seen.size} topics equal; samples: ${JSON.stringify(counts)}`);
    process.exit(0);
  }
}

// asks for everything, and never reads again
const deaf = connect((message) => {
  if (message.op === "advertise") {
    const all = message.channels.map(({ id }) => ({ id, channelId: id }));
    deaf.send(JSON.stringify({ op: "subscribe", subscriptions: all }), () => deaf._socket.pause());
  }
});
deaf.on("open", () => connect(advertised, arrived));
