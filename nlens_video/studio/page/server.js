// Requests to the server; its errors are lines for the user.

/** What the server does not do. */
export class Refusal extends Error {
  /** @param {string} words @param {number} status */
  constructor(words, status) {
    super(words);
    this.status = status;
  }

  /** Whether the shot file was changed by another page or program. */
  get changed() {
    return this.status === 409;
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
  if (!answer.ok) throw new Refusal(said.error ?? `the server answers ${answer.status}`, answer.status);
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
