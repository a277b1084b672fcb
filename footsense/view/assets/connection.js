// The WebSocket to the server: messages by their type, cycles as arrays, and a new connection after a lost one.

const RETRY_MS = 1000;

export class Connection {
  constructor(on) {
    this.on = on;
    this.undrawn = 0;
    this.#open();
  }

  #open() {
    const address = new URL("/", location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(address, "footsense.view.v1");
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.undrawn = 0; this.on.offline(""); };
    this.socket.onmessage = ({ data }) => {
      if (typeof data === "string") {
        const message = JSON.parse(data);
        this.on[message.type]?.(message);
      } else {
        this.#cycles(data);
      }
    };
    this.socket.onclose = ({ reason }) => {
      this.on.offline(reason ? `The viewer ended the connection: ${reason}.` : "The viewer does not answer.");
      setTimeout(() => this.#open(), RETRY_MS);
    };
  }

  #cycles(data) {
    const [kind, n, legs, signals] = new Uint32Array(data, 0, 4);
    const t = new Float64Array(data, 16, n), v = new Float32Array(data, 16 + 8 * n, n * legs * signals);
    if (kind === 0) this.undrawn++;
    this.on.cycles(kind, t, v);
  }

  // Tells the server that everything received is drawn: it sends no more than the page can draw.
  drawn() {
    for (; this.undrawn > 0; this.undrawn--) this.send({ type: "drawn" });
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}
