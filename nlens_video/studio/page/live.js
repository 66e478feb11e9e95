// Pictures from the server: of what is asked for, only the newest; one at a time while dragging.

/** @typedef {import("./shot.js").Tables} Tables */
/** @typedef {{number: number, frame: number, kind: string, error?: string, [key: string]: any}} About */

const REST_AFTER_MS = 200;
/** Pictures while something is dragged. */
export const QUICK = ["drag", "light"];

export class Live {
  /**
   * @param {(about: About, picture: Blob | null) => void} onPicture
   * @param {(said: any) => void} onTold
   * @param {(connected: boolean) => void} onConnected
   */
  constructor(onPicture, onTold, onConnected) {
    this.onPicture = onPicture;
    this.onTold = onTold;
    this.onConnected = onConnected;
    this.connected = false;
    this.number = 0;
    this.oldest = 1; // number of the first picture that is not dropped
    /** @type {number | null} of the picture that is being made while dragging */
    this.flying = null;
    /** @type {{tables: Tables, frame: number, kind: string} | null} */
    this.waiting = null;
    /** @type {number | undefined} */
    this.timer = undefined;
    this.connect();
  }

  connect() {
    const address = new URL("live", document.baseURI);
    address.protocol = "ws:";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.connected = true;
      this.onConnected(true);
      this.flying = null;
      this.flush();
    };
    this.socket.onmessage = (event) => this.take(event.data);
    this.socket.onclose = () => {
      this.connected = false;
      this.onConnected(false);
      window.setTimeout(() => this.connect(), 2000);
    };
  }

  /**
   * Ask for a picture. While dragging at once, at rest after a moment without another wish.
   * @param {Tables} tables
   * @param {number} frame
   * @param {string} kind
   */
  ask(tables, frame, kind) {
    window.clearTimeout(this.timer);
    this.waiting = { tables, frame, kind };
    if (QUICK.includes(kind)) this.flush();
    else this.timer = window.setTimeout(() => this.flush(), REST_AFTER_MS);
  }

  /** What was asked for until now is not wanted any more: the shot or the frame is another. */
  drop() {
    window.clearTimeout(this.timer);
    this.waiting = null;
    this.oldest = this.number + 1;
  }

  /** @param {About} about */
  wants(about) {
    return about.number >= this.oldest && (about.number === this.number || QUICK.includes(about.kind));
  }

  flush() {
    const wish = this.waiting;
    if (!wish || this.socket?.readyState !== WebSocket.OPEN) return;
    const quick = QUICK.includes(wish.kind);
    if (quick && this.flying !== null) return;
    this.waiting = null;
    this.number += 1;
    this.flying = quick ? this.number : null;
    this.socket.send(JSON.stringify({ number: this.number, ...wish }));
  }

  /** @param {string | ArrayBuffer} data */
  take(data) {
    if (typeof data === "string") {
      this.onTold(JSON.parse(data));
      return;
    }
    const length = new DataView(data).getUint32(0);
    /** @type {About} */
    const about = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const rest = data.slice(4 + length);
    if (about.number === this.flying) this.flying = null;
    if (this.wants(about)) {
      this.onPicture(about, rest.byteLength ? new Blob([rest], { type: "image/jpeg" }) : null);
    }
    if (QUICK.includes(this.waiting?.kind ?? "")) this.flush();
  }
}
