// Requests to the server; its errors are lines for the user.

/** What the server does not do. */
export class Refusal extends Error {
  /**
   * @param {string} words
   * @param {"shot" | "result" | ""} [holds] which file would be replaced: the shot file that another page or
   *   program has changed, or a result that the studio has not rendered
   */
  constructor(words, holds = "") {
    super(words);
    this.holds = holds;
  }
}

/**
 * @param {string} where
 * @param {RequestInit} [options]
 * @returns {Promise<any>}
 */
export async function request(where, options) {
  const answer = await asked(where, options);
  const said = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Refusal(said.error ?? `the server answers ${answer.status}`, said.holds);
  return said;
}

/**
 * @param {string} where
 * @param {RequestInit} [options]
 * @returns {Promise<Response>}
 */
export async function asked(where, options) {
  try {
    return await fetch(where, options);
  } catch {
    throw new Error("the server does not answer");
  }
}

/** @param {string} where @param {object} body */
export function post(where, body) {
  return request(where, { method: "POST", body: JSON.stringify(body) });
}
