// The shot as it is edited, with its history. It is the content of the shot file and nothing else.

/** @typedef {{[key: string]: any}} Table */
/** @typedef {{[table: string]: Table}} Tables */

/** The text of a shot file, whose version is 2 where it lists its objects. @param {Tables} tables */
export function toToml(tables) {
  const lines = [`version = ${Array.isArray(tables["object"]) ? 2 : 1}`];
  for (const [name, content] of Object.entries(tables)) {
    const listed = Array.isArray(content);
    for (const table of listed ? content : [content]) {
      lines.push("", listed ? `[[${name}]]` : `[${name}]`, ...Object.entries(table).map(([key, value]) => `${key} = ${valueOf(value)}`));
    }
  }
  return `${lines.join("\n")}\n`;
}

/** A value as TOML writes it: as JSON does, but for tables. @param {any} value @returns {string} */
function valueOf(value) {
  if (Array.isArray(value)) return `[${value.map(valueOf).join(", ")}]`;
  if (typeof value !== "object") return JSON.stringify(value);
  return `{ ${Object.entries(value).map(([key, part]) => `${key} = ${valueOf(part)}`).join(", ")} }`;
}

export class Shot {
  /** @param {Tables} tables */
  constructor(tables) {
    /** @type {Tables} */
    this.tables = tables;
    /** @type {string[]} */
    this.past = [];
    /** @type {string[]} */
    this.future = [];
    /** @type {string | null} */
    this.held = null;
    /** @type {string} */
    this.saved = JSON.stringify(tables);
  }

  /** @param {string} table @param {string} key @returns {any} */
  get(table, key) {
    return this.tables[table]?.[key];
  }

  /**
   * Change some keys; undefined takes a key away.
   * @param {string} table
   * @param {Table} changes
   */
  set(table, changes) {
    const before = JSON.stringify(this.tables);
    const entries = { ...this.tables[table], ...changes };
    for (const key of Object.keys(entries)) if (entries[key] === undefined) delete entries[key];
    const tables = { ...this.tables, [table]: entries };
    if (!Object.keys(entries).length) delete tables[table];
    if (JSON.stringify(tables) === before) return;
    this.tables = tables;
    if (this.held === null) this.remember(before);
  }

  /** Put other tables in place of all. @param {Tables} tables */
  replace(tables) {
    const before = JSON.stringify(this.tables);
    if (JSON.stringify(tables) === before) return;
    this.tables = tables;
    if (this.held === null) this.remember(before);
  }

  /** Changes from now until `release` are one step of the history. */
  hold() {
    if (this.held === null) this.held = JSON.stringify(this.tables);
  }

  release() {
    const before = this.held;
    this.held = null;
    if (before !== null && before !== JSON.stringify(this.tables)) this.remember(before);
  }

  /** @param {string} before */
  remember(before) {
    this.past.push(before);
    if (this.past.length > 500) this.past.shift();
    this.future = [];
  }

  undo() {
    this.release();
    const before = this.past.pop();
    if (before === undefined) return;
    this.future.push(JSON.stringify(this.tables));
    this.tables = JSON.parse(before);
  }

  redo() {
    this.release();
    const after = this.future.pop();
    if (after === undefined) return;
    this.past.push(JSON.stringify(this.tables));
    this.tables = JSON.parse(after);
  }

  get unsaved() {
    return JSON.stringify(this.tables) !== this.saved;
  }
}
