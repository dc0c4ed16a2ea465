// SPDX-License-Identifier: Apache-2.0
// The connection. It comes back by itself.
const kTopics = { "/pose": takePose, "/map/blocks": takeBlocks, "/objects": takeObjects, "/camera/color": takePicture,
  "/camera/annotations": takeAnnotations, "/camera/calibration": (d) => { calibration = read(d, { 2: "width", 3: "height", 6: ["K", doubles] }); },
  "/health": takeHealth, "/log": takeLog, "/map": () => link.onCloud?.(), "/tf": () => {} };
const link = {
  channels: new Map(), wait: 500, bytes: 0, onCloud: null,
  open() {
    const socket = this.socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/`, ["foxglove.websocket.v1"]);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => (typeof data === "string" ? this.word(JSON.parse(data)) : this.message(data));
    socket.onclose = (e) => {
      $("offline").hidden = false;
      $("why").textContent = (e.reason || "if it asks for a token, open this page with ?token=…") + "; trying again";
      $("state").className = $("state").textContent = "offline";
      this.channels.clear();
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(1.6 * this.wait, 4000);
    };
  },
  word(m) {
    if (m.op === "serverInfo") {
      this.wait = 500;
      $("offline").hidden = true;
      if (m.sessionId !== session) { session = m.sessionId; forget(); Object.assign(recorded, { items: [], bytes: 0, calibration: [] }); }
    }
    if (m.op === "advertise") for (const c of m.channels) {
      this.channels.set(c.id, c);
      // /map is asked for when a file is saved: /map/blocks tells the same in pieces.
      if (kTopics[c.topic] && c.topic !== "/map" && (c.topic !== "/camera/color" || shown.preview)) this.subscribe(c.topic);
    }
  },
  send(m) { if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(m)); },
  id(topic) { for (const c of this.channels.values()) if (c.topic === topic) return c.id; },
  subscribe(topic) { const id = this.id(topic); if (id) this.send({ op: "subscribe", subscriptions: [{ id, channelId: id }] }); },
  unsubscribe(topic) { const id = this.id(topic); if (id) this.send({ op: "unsubscribe", subscriptionIds: [id] }); },
  message(buffer) {
    const head = new DataView(buffer), channel = head.getUint32(1, true), stamp = head.getBigUint64(5, true), data = new Uint8Array(buffer, 13);
    this.bytes += buffer.byteLength;
    record(channel, stamp, data);
    kTopics[this.channels.get(channel)?.topic]?.(data, stamp);
  },
};
