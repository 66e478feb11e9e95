// The shot file: saved, rendered, read again, and handed out as a file or as a command.

import { field, one } from "./elements.js";
import { attempt } from "./messages.js";
import { post, request } from "./server.js";
import { toToml } from "./shot.js";

export class ShotFile {
  /**
   * @param {import("./shot.js").Shot} shot
   * @param {{path: string, revision: string}} about the file, as it was read; no revision where there is none
   * @param {() => void} onSaved
   * @param {() => void} onRead the shot is another one
   */
  constructor(shot, { path, revision }, onSaved, onRead) {
    this.shot = shot;
    this.path = path;
    this.revision = revision; // as it was read or saved last
    this.onSaved = onSaved;
    this.onRead = onRead;
    /** @type {Promise<void>} ends with what was to be kept last: each needs the revision of the one before */
    this.kept = Promise.resolve();
    if (!revision) shot.saved = "";
    one("path").textContent = path;
    one("reload").addEventListener("click", () => void attempt(() => this.read()));
    one("save").addEventListener("click", () => void this.keep("save"));
    one("render").addEventListener("click", () => void this.keep("render"));
    one("copy").addEventListener("click", () => void attempt(() => this.copyCommand()));
    one("keep").addEventListener("click", () => this.download());
    window.addEventListener("beforeunload", (event) => {
      if (shot.unsaved && shot.past.length) event.preventDefault();
    });
  }

  /**
   * Send the shot to be kept.
   * @param {"save" | "render"} where
   * @param {("shot" | "result")[]} [over] files that are replaced whatever they hold
   */
  keep(where, over = []) {
    this.kept = this.kept.then(() => attempt(async () => {
      const text = JSON.stringify(this.shot.tables);
      const words = new URLSearchParams();
      if (!over.includes("shot")) words.set("revision", this.revision);
      if (over.includes("result")) words.set("replace", "1");
      ({ revision: this.revision } = await post(`${where}?${words}`, this.shot.tables));
      this.shot.saved = text;
      this.onSaved();
    }, (holds) => void this.keep(where, [...over, holds])));
    return this.kept;
  }

  async read() {
    const now = await request("shot");
    this.revision = now.revision;
    this.shot.replace(now.tables);
    this.shot.saved = JSON.stringify(now.tables);
    this.onRead();
  }

  async copyCommand() {
    const { command } = await post("command", this.shot.tables);
    field("command").value = command;
    try {
      await navigator.clipboard.writeText(command);
      one("saved").textContent = "· command copied";
    } catch { // browsers refuse it to a page of another machine, for that is unencrypted
      one("command-row").hidden = false;
      field("command").select();
    }
  }

  download() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([toToml(this.shot.tables)], { type: "application/toml" }));
    link.download = this.path.split("/").pop() ?? "";
    link.click();
    URL.revokeObjectURL(link.href);
  }
}
