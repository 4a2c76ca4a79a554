// Foxglove's own client of its websocket protocol, with somebody else's Protocol Buffers: what came, a line each.
//
// Usage: node foxglove_client.cjs HOST:PORT [dies]       needs the npm packages @foxglove/ws-protocol, ws and protobufjs
//
// With `dies` it ends by SIGKILL in the middle of its subscription.
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { WebSocket } = require("ws");
const protobuf = require("protobufjs");
const { FileDescriptorSet } = require("protobufjs/ext/descriptor");

const TICKS = 50;
const [address, end] = process.argv.slice(2);
const client = new FoxgloveClient({
  ws: new WebSocket(`ws://${address}`, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]),
});
const decoders = new Map();
const seen = { ticks: [], pressures: new Set() };

client.on("error", (error) => {
  console.log("error", error.message);
  process.exit(1);
});
client.on("close", (event) => {
  console.log("closed", event.code ?? "");
  process.exit(1);
});
client.on("serverInfo", (info) => console.log("server", info.name, JSON.stringify(info.capabilities)));
client.on("status", (status) => console.log("status", status.level, status.message));
client.on("advertise", (channels) => {
  for (const channel of channels) {
    if (channel.encoding === "json") {
      const { properties } = JSON.parse(channel.schema);
      console.log("channel", channel.topic, channel.encoding, channel.schemaName, Object.keys(properties).length > 2);
      decoders.set(client.subscribe(channel.id), { topic: channel.topic });
      continue;
    }
    const schema = FileDescriptorSet.decode(Buffer.from(channel.schema, "base64"));
    const root = protobuf.Root.fromDescriptor(schema);
    const type = root.lookupType(channel.schemaName);
    console.log("channel", channel.topic, channel.encoding, channel.schemaName, Object.keys(type.fields).length > 2);
    decoders.set(client.subscribe(channel.id), { topic: channel.topic, type });
  }
  // Read-only: what a client would publish is answered with a status, and the connection goes on.
  client.advertise({ topic: "/command", encoding: "json", schemaName: "none" });
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic, type } = decoders.get(subscriptionId);
  if (topic === "/state") {
    const { up, state } = JSON.parse(new TextDecoder().decode(data));
    if (!seen.state) {
      console.log("state", up && typeof state === "string" ? "up" : state);
    }
    seen.state = state;
    return;
  }
  const message = type.decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
  if (topic !== "/tick") {
    return;
  }
  seen.ticks.push({ number: message.tick, at: timestamp });
  seen.pressures.add(message.p_pos_kpa);
  if (seen.ticks.length < TICKS) {
    return;
  }
  if (end === "dies") {
    process.kill(process.pid, "SIGKILL");
    return;
  }
  const pairs = seen.ticks.slice(1).map((tick, k) => [seen.ticks[k], tick]);
  // A tick without its frame has no reading.
  const pressures = [...seen.pressures].filter((kpa) => !Number.isNaN(kpa));
  console.log("forward", pairs.every(([before, tick]) => tick.number >= before.number && tick.at >= before.at));
  console.log("moves", pressures.length > 1);
  console.log("gauge_kpa", pressures.every((kpa) => Math.abs(kpa) < 200));
  console.log("now", Math.abs(Date.now() - Number(timestamp / 1_000_000n)) < 10_000);
  process.exit(0);
});
