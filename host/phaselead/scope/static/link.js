// The websocket to the hub: frames and states in, orders out; comes back by itself.

const AGAIN_MS = 500;
export const COLUMNS = 1, SPECTRUM = 2, LOOP = 3;

// One binary frame as host/phaselead/scope/view.py packs it: little-endian, arrays behind the head.
export function decode(buffer) {
  const view = new DataView(buffer);
  const frame = {
    kind: view.getUint8(0), anew: view.getUint8(1) === 1, axes: view.getUint8(2), traces: view.getUint8(3),
    columns: view.getUint32(4, true), ticks: view.getUint32(8, true), dropped: view.getUint32(12, true),
    first: view.getFloat64(16, true), trigger: view.getFloat64(24, true), end: view.getFloat64(32, true),
  };
  let at = 40;
  const take = (count) => {
    const part = new Float32Array(buffer, at, count);
    at += 4 * count;
    return part;
  };
  if (frame.kind === COLUMNS) {
    const size = frame.axes * frame.traces * frame.columns;
    frame.low = take(size);
    frame.high = frame.ticks > 1 ? take(size) : frame.low;
    frame.lost = new Uint8Array(buffer, at, frame.columns);
  } else if (frame.kind === SPECTRUM) {
    frame.fHz = take(frame.columns);
    frame.amplitude = Array.from({ length: frame.axes }, () => take(frame.columns));
  } else {
    frame.pairs = Array.from({ length: frame.axes }, () => [take(frame.columns), take(frame.columns)]);
  }
  return frame;
}

export class Link {
  constructor({ onFrame, onState, onWelcome, onGone }) {
    this.on = { onFrame, onState, onWelcome, onGone };
    this.waiting = new Map();
    this.number = 0;
    this.connect();
  }

  connect() {
    this.socket = new WebSocket(`ws://${location.host}/ws`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => this.socket.send(JSON.stringify({ tab: sessionStorage.getItem("tab") ?? "" }));
    this.socket.onmessage = ({ data }) => (typeof data === "string" ? this.said(JSON.parse(data)) : this.on.onFrame(decode(data)));
    this.socket.onclose = () => {
      for (const done of this.waiting.values()) done({ ok: false, said: "the scope does not answer" });
      this.waiting.clear();
      this.on.onGone();
      setTimeout(() => this.connect(), AGAIN_MS);
    };
  }

  said(message) {
    if (message.welcome) {
      sessionStorage.setItem("tab", message.welcome.tab);
      this.on.onWelcome(message.welcome);
    } else if (message.state) {
      this.on.onState(message.state);
    } else if (this.waiting.has(message.reply)) {
      this.waiting.get(message.reply)(message);
      this.waiting.delete(message.reply);
    }
  }

  ask(message) {
    if (this.socket.readyState !== WebSocket.OPEN) return Promise.resolve({ ok: false, said: "the scope does not answer" });
    const id = ++this.number;
    this.socket.send(JSON.stringify({ ...message, id }));
    return new Promise((done) => this.waiting.set(id, done));
  }

  // The hub sends no more than a few frames that have not been drawn.
  seen() {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send('{"seen": true}');
  }

  stop() {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send('{"stop": true}');
  }
}
