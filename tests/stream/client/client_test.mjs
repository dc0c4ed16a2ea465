// SPDX-License-Identifier: Apache-2.0
// node client_test.mjs SERVER: what the official client, and some unkind ones, get from the stream server.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import net from "node:net";
import { createInterface } from "node:readline";
import { after, afterEach, before, test } from "node:test";
import { setTimeout as sleep } from "node:timers/promises";

import { foxgloveMessageSchemas, generateProto } from "@foxglove/schemas/internal.js";
import wsProtocol from "@foxglove/ws-protocol";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor.js";
import WebSocket from "ws";

const { FoxgloveClient } = wsProtocol;
const kPoints = 200_000;
let server, lines, port;
const sockets = [];  // of the running test

/// The next line that the server prints.
const nextLine = async () => (await lines.next()).value;
async function stats() {
  server.stdin.write("stats\n");
  return JSON.parse(await nextLine());
}
async function until(what, condition, timeout_ms = 10_000) {
  for (const end = Date.now() + timeout_ms; Date.now() < end; await sleep(20)) if (await condition()) return;
  assert.fail(`waited ${timeout_ms} ms for ${what}`);
}

function connect(protocols = ["foxglove.websocket.v1"]) {
  const socket = new WebSocket(`ws://127.0.0.1:${port}`, protocols);
  sockets.push(socket);
  const client = new FoxgloveClient({ ws: socket });
  const seen = { socket, client, channels: [], status: [], messages: new Map(), decoders: new Map(), times: new Map() };
  const topics = new Map();
  client.on("serverInfo", (event) => (seen.info = event));
  client.on("status", (event) => seen.status.push(event));
  client.on("close", (event) => (seen.closed = event));
  client.on("advertise", (channels) => {
    seen.channels.push(...channels);
    for (const c of channels) {
      const set = descriptor.FileDescriptorSet.decode(Buffer.from(c.schema, "base64"));
      seen.decoders.set(c.topic, protobuf.Root.fromDescriptor(set).lookupType(c.schemaName));
    }
  });
  client.on("message", ({ subscriptionId, timestamp, data }) => {
    const topic = topics.get(subscriptionId);
    const message = seen.decoders.get(topic).decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    if (!seen.messages.has(topic)) seen.messages.set(topic, []);
    seen.messages.get(topic).push({ timestamp, message, time: Date.now() });
  });
  seen.count = (topic) => seen.messages.get(topic)?.length ?? 0;
  seen.subscribe = (topic) => {
    const id = client.subscribe(seen.channels.find((c) => c.topic === topic).id);
    topics.set(id, topic);
    return id;
  };
  seen.ready = () => until("the channels", () => seen.channels.length === 3);
  return seen;
}

/// A client without any library: shakes hands, sends what it is given, and reads only when told to.
async function rawClient() {
  const socket = net.connect(port, "127.0.0.1");
  sockets.push(socket);
  socket.on("error", () => {});
  await once(socket, "connect");
  socket.write("GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n" +
               "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.websocket.v1\r\n\r\n");
  await once(socket, "data");
  return {
    socket,
    send(text) {
      const body = Buffer.from(text);
      assert.ok(body.length < 126);
      socket.write(Buffer.concat([Buffer.from([0x81, 0x80 | body.length, 0, 0, 0, 0]), body]));  // masked by zeros
    },
  };
}
const kSubscribeAll = '{"op":"subscribe","subscriptions":[' + [1, 2, 3].map((i) => `{"id":${i},"channelId":${i}}`) + "]}";

function checkPose({ timestamp, message }) {
  const i = Number((timestamp - 1_700_000_000_000_000_000n) / 10_000_000n);
  assert.equal(BigInt(message.timestamp.seconds) * 1_000_000_000n + BigInt(message.timestamp.nanos), timestamp);
  assert.equal(message.frameId, "map");
  // T_map_odom turns by 90 degrees about z and shifts by (1, 2, 3): x of odom is y of map.
  const { position: p, orientation: q } = message.pose;
  for (const [got, want] of [[p.x, 1], [p.y, 2 + 0.01 * i], [p.z, 3.5], [q.x, 0], [q.y, 0], [q.z, Math.SQRT1_2],
                             [q.w, Math.SQRT1_2]]) {
    assert.ok(Math.abs(got - want) < 1e-9, `${got} is not ${want}`);
  }
  return i;
}

function checkCloud({ timestamp, message }) {
  assert.equal(timestamp % 1_000_000_000n, 7n);
  const generation = Number(timestamp / 1_000_000_000n);
  assert.equal(message.frameId, "map");
  assert.equal(message.pointStride, 16);
  assert.deepEqual(message.fields.map((f) => [f.name, f.offset, f.type]), [["x", 0, 7], ["y", 4, 7], ["z", 8, 7],
                   ["red", 12, 1], ["green", 13, 1], ["blue", 14, 1], ["alpha", 15, 1]]);
  assert.equal(message.pose.orientation.w, 1);
  assert.equal(message.data.length, 16 * kPoints);
  const view = new DataView(message.data.buffer, message.data.byteOffset, message.data.byteLength);
  for (let k = 0; k < kPoints; ++k) {  // not assert.equal: 1.4 million of them take seconds
    const ok = view.getFloat32(16 * k, true) === Math.fround(Math.fround(0.001) * Math.fround(k)) &&
      view.getFloat32(16 * k + 4, true) === -k && view.getFloat32(16 * k + 8, true) === generation &&
      view.getUint32(16 * k + 12, true) === ((0xff000000 | k) >>> 0);
    assert.ok(ok, `point ${k} of cloud ${generation}`);
  }
  return generation;
}

before(async () => {
  server = spawn(process.argv[2], { stdio: ["pipe", "pipe", "inherit"] });
  lines = createInterface({ input: server.stdout })[Symbol.asyncIterator]();
  port = Number(await nextLine());
});

afterEach(async () => {
  for (const socket of sockets.splice(0)) socket instanceof WebSocket ? socket.terminate() : socket.destroy();
  if (server.exitCode === null) await until("all clients to be gone", async () => (await stats()).clients === 0);
});

after(() => server.kill());

test("greets with serverInfo and channels whose schemas are the official ones", async () => {
  const c = connect();
  await c.ready();
  assert.equal(c.socket.protocol, "foxglove.websocket.v1");
  assert.equal(c.info.name, "stillmap");
  assert.deepEqual(c.info.capabilities, []);
  assert.deepEqual(c.channels.map((x) => [x.topic, x.encoding, x.schemaName, x.schemaEncoding]),
                   [["/tf", "protobuf", "foxglove.FrameTransforms", "protobuf"],
                    ["/pose", "protobuf", "foxglove.PoseInFrame", "protobuf"],
                    ["/map", "protobuf", "foxglove.PointCloud", "protobuf"]]);
  for (const decoder of c.decoders.values()) {
    for (const type of decoder.parent.nestedArray.filter((t) => t instanceof protobuf.Type)) {
      const schema = foxgloveMessageSchemas[type.name];
      const enums = type.nestedArray.map(() => schema.fields.find((f) => f.type.type === "enum").type.enum);
      const source = generateProto(schema, enums);
      const official = protobuf.parse(source, { keepCase: true }).root.lookupType(`foxglove.${type.name}`);
      const shape = (t) => Object.fromEntries(t.fieldsArray.map((f) =>
          [f.name.replace(/_([a-z])/g, (_, x) => x.toUpperCase()), [f.id, f.type.split(".").at(-1), f.repeated]]));
      assert.deepEqual(shape(type), shape(official), type.name);
      for (const e of type.nestedArray) assert.deepEqual({ ...e.values }, { ...official.get(e.name).values }, e.name);
    }
  }
});

test("serves the sdk's subprotocol alike, prefers none, and refuses others", async () => {
  const sdk = connect(["foxglove.sdk.v1", "foxglove.websocket.v1"]);
  await sdk.ready();
  assert.equal(sdk.socket.protocol, "foxglove.sdk.v1");
  sdk.subscribe("/pose");
  await until("a pose", () => sdk.count("/pose") > 0);
  checkPose(sdk.messages.get("/pose")[0]);
  sdk.client.close();
  const bare = connect([]);
  await bare.ready();
  bare.client.close();
  const other = new WebSocket(`ws://127.0.0.1:${port}`, ["chat.v1"]);
  await new Promise((resolve) => other.on("error", resolve));
});

test("poses and transforms arrive every frame, in order, with the values that were published", async () => {
  const c = connect();
  await c.ready();
  c.subscribe("/pose");
  c.subscribe("/tf");
  await until("100 poses", () => c.count("/pose") > 100 && c.count("/tf") > 100);
  const numbers = c.messages.get("/pose").map(checkPose);
  for (let i = 1; i < numbers.length; ++i) assert.equal(numbers[i], numbers[i - 1] + 1);
  for (const { timestamp, message } of c.messages.get("/tf")) {
    const i = Number((timestamp - 1_700_000_000_000_000_000n) / 10_000_000n);
    const [odom, base, camera] = message.transforms;
    assert.deepEqual(message.transforms.map((t) => [t.parentFrameId, t.childFrameId]),
                     [["map", "odom"], ["odom", "base"], ["base", "camera"]]);
    assert.ok(Math.abs(base.translation.x - 0.01 * i) < 1e-9 && odom.translation.z === 3 && camera.translation.z === 0.5);
    assert.ok(Math.abs(odom.rotation.z - Math.SQRT1_2) < 1e-9 && camera.rotation.w === 1);
  }
});

test("a client that receives poses and clouds costs the library no heap", async () => {
  const c = connect();
  await c.ready();
  for (const topic of ["/pose", "/tf", "/map"]) c.subscribe(topic);
  await until("a cloud", () => c.count("/map") > 0);
  const [start, poses] = [await stats(), c.count("/pose")];
  await until("100 more poses and 2 clouds", () => c.count("/pose") > poses + 100 && c.count("/map") > 2);
  assert.equal((await stats()).allocations, start.allocations);
});

test("the map comes whole on subscribing, then at most once a second, and an unchanged one to newcomers", async () => {
  const c = connect();
  await c.ready();
  c.subscribe("/map");
  await until("3 clouds", () => c.count("/map") >= 3);
  const clouds = c.messages.get("/map");
  const generations = clouds.map(checkCloud);
  for (let i = 1; i < clouds.length; ++i) {
    assert.ok(generations[i] > generations[i - 1]);
    if (i > 1) assert.ok(clouds[i].time - clouds[i - 1].time > 800, `${clouds[i].time - clouds[i - 1].time} ms`);
  }
  server.stdin.write("freeze\n");
  await sleep(1500);  // what was under way arrives, and the buffer is offered again
  const before = c.count("/map");
  const late = connect();
  await late.ready();
  late.subscribe("/map");
  await until("the kept cloud", () => late.count("/map") === 1, 2000);
  assert.equal(checkCloud(late.messages.get("/map")[0]), checkCloud(c.messages.get("/map").at(-1)));
  await sleep(1500);
  assert.equal(c.count("/map"), before, "nothing is sent while nothing changes");
  server.stdin.write("thaw\n");
  await until("the changed cloud at both", () => late.count("/map") > 1 && c.count("/map") > before);
});

test("after unsubscribing nothing more comes, and one can subscribe again", async () => {
  const c = connect();
  await c.ready();
  const id = c.subscribe("/pose");
  await until("poses", () => c.count("/pose") > 3);
  c.client.unsubscribe(id);
  await sleep(200);
  const count = c.count("/pose");
  await sleep(200);
  assert.equal(c.count("/pose"), count);
  c.subscribe("/pose");
  await until("poses again", () => c.count("/pose") > count + 3);
  assert.deepEqual(c.status, []);
});

test("every bad message is answered with a status, counted, and changes nothing", async () => {
  const c = connect();
  await c.ready();
  c.subscribe("/pose");
  const before = (await stats()).bad;
  const bad = ["", "hello", '{"op":"subscribe"}', '{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]}',
               '{"op":"subscribe","subscriptions":[{"id":77,"channelId":99}]}',
               '{"op":"subscribe","subscriptions":[{"id":78,"channelId":2}]}',
               '{"op":"unsubscribe","subscriptionIds":[12345]}', '{"op":"setParameters","parameters":[]}',
               '{"op":"advertise","channels":[]}', "[".repeat(3000), `{"op":"${"x".repeat(100_000)}"}`,
               Buffer.from([1, 0, 0, 0, 0, 42])];
  for (const [i, message] of bad.entries()) {
    c.socket.send(message);
    await until(`the answer to ${message.slice(0, 60)}`, () => c.status.length === i + 1, 3000);
  }
  assert.ok(c.status.every((s) => s.level === 2 && s.message.length > 10));
  assert.match(c.status[4].message, /no channel 99/);
  assert.match(c.status[6].message, /no subscription 12345/);
  assert.match(c.status[10].message, /4096 bytes/);
  assert.equal((await stats()).bad, before + bad.length);
  const poses = c.count("/pose");
  await until("poses to go on", () => c.count("/pose") > poses + 5);
});

test("a client too many is turned away with a reason, and finds a place when one leaves", async () => {
  const clients = Array.from({ length: 8 }, () => connect());
  await Promise.all(clients.map((c) => c.ready()));
  const ninth = connect();
  await until("the refusal", () => ninth.closed);
  assert.equal(ninth.closed.code, 1013);
  assert.match(ninth.closed.reason, /stream\.max_clients/);
  assert.equal(ninth.info, undefined);
  assert.equal((await fetch(`http://127.0.0.1:${port}/health`)).status, 200);
  clients.pop().client.close();
  await until("the place", async () => (await stats()).clients === 7);
  const next = connect();
  await next.ready();
  const end = await stats();
  assert.equal(end.peak, 8);
  assert.ok(end.refused >= 1);
});

test("a client that never reads stalls nobody, and is given up on in the middle of a cloud", async () => {
  const good = connect();
  await good.ready();
  good.subscribe("/pose");
  good.subscribe("/map");
  await until("a cloud", () => good.count("/map") > 0);
  const stuck = await rawClient();
  stuck.socket.pause();
  stuck.send(kSubscribeAll);
  const start = await stats();
  const [poses, clouds, begin] = [good.count("/pose"), good.count("/map"), Date.now()];
  await sleep(3000);
  const numbers = good.messages.get("/pose").map(checkPose);
  for (let i = 1; i < numbers.length; ++i) assert.equal(numbers[i], numbers[i - 1] + 1);
  assert.ok(good.count("/pose") > poses + 100);
  await until("it to be given up on", async () => (await stats()).given_up === start.given_up + 1);
  assert.ok(Date.now() - begin < 8000);
  await until("clouds to go on", () => good.count("/map") > clouds + 1);
  checkCloud(good.messages.get("/map").at(-1));
});

test("clients that vanish in the middle of a cloud leave nothing behind", async () => {
  const good = connect();
  await good.ready();
  good.subscribe("/map");
  await until("a cloud", () => good.count("/map") > 0);
  for (let i = 0; i < 10; ++i) {
    const raw = await rawClient();
    raw.send(kSubscribeAll);
    await once(raw.socket, "data");
    raw.socket.resetAndDestroy();
  }
  const clouds = good.count("/map");
  await until("whole clouds to go on", () => good.count("/map") > clouds + 1);
  checkCloud(good.messages.get("/map").at(-1));
  await until("their places to be free", async () => (await stats()).clients === 1);
});

test("HTTP: health, metrics and the page, and nothing else", async () => {
  const get = (path, options) => fetch(`http://127.0.0.1:${port}${path}`, options);
  const health = await get("/health");
  assert.equal(health.headers.get("content-type"), "application/json");
  assert.deepEqual(await health.json(), { state: "tracking" });
  const metrics = await get("/metrics");
  assert.match(metrics.headers.get("content-type"), /^text\/plain; version=0\.0\.4/);
  assert.equal(await metrics.text(), "stillmap_up 1\n");
  const page = await get("/");
  assert.match(page.headers.get("content-type"), /^text\/html/);
  assert.match(await page.text(), /Foxglove[^]*\/health[^]*\/metrics/);
  for (const path of ["/etc/passwd", "/health/", "/index.html", `/${"a".repeat(1500)}`]) {
    assert.equal((await get(path)).status, 404, path);
  }
  for (const method of ["POST", "PUT", "DELETE"]) {
    assert.equal((await get("/health", { method })).status, 405, method);
  }
});

test("garbage, half requests and many idle connections keep no one out", async () => {
  for (let i = 0; i < 60; ++i) {
    const socket = net.connect(port, "127.0.0.1");
    socket.on("error", () => {});
    socket.write(["\x00\x01\x02\xff".repeat(50), "GET /health HTTP/1.1\r\nHost", "GET " + "x".repeat(20_000), ""][i % 4]);
    sockets.push(socket);
  }
  await until("health", async () => {
    try {
      return (await fetch(`http://127.0.0.1:${port}/health`, { signal: AbortSignal.timeout(1000) })).status === 200;
    } catch {
      return false;
    }
  }, 15_000);
  const c = connect();
  await c.ready();
});

test("stopping says goodbye to every client and takes less than a second", async () => {
  const clients = [connect(), connect()];
  await Promise.all(clients.map((c) => c.ready()));
  clients[0].subscribe("/map");
  const stuck = await rawClient();
  stuck.socket.pause();
  stuck.send(kSubscribeAll);
  await sleep(300);
  const begin = Date.now();
  server.stdin.write("quit\n");
  const [code] = await once(server, "exit");
  assert.equal(code, 0);
  assert.ok(Date.now() - begin < 1500, `${Date.now() - begin} ms`);
  await until("the farewells", () => clients.every((c) => c.closed));
  for (const c of clients) assert.equal(c.closed.code, 1001);
});
