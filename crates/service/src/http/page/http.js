// Requests to the service. Errors are problem+json, which names the limit and the remedy.

/** The reason in a response that refuses. */
function reasonOf(status, text) {
  try {
    const problem = JSON.parse(text);
    return [problem.title, problem.detail].filter(Boolean).join(": ");
  } catch {
    return `the service answered ${status}`;
  }
}

/** A request below `/api/v1`; `{ ok, status, body, reason }`. Never throws. */
export async function request(method, path, { json, headers = {} } = {}) {
  const options = { method, headers: { ...headers }, credentials: "same-origin" };
  if (json !== undefined) {
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(json);
  }
  try {
    const response = await fetch(new URL(`api/v1/${path}`, location.href), options);
    const text = await response.text();
    if (!response.ok) return { ok: false, status: response.status, reason: reasonOf(response.status, text) };
    return { ok: true, status: response.status, body: text ? JSON.parse(text) : null };
  } catch {
    return { ok: false, status: 0, reason: "the service does not answer" };
  }
}

/** Uploads bytes with progress from 0 to 1; the same answer. */
export function upload(path, bytes, type, progress) {
  return new Promise((resolve) => {
    const sending = new XMLHttpRequest();
    sending.open("PUT", new URL(`api/v1/${path}`, location.href));
    sending.setRequestHeader("Content-Type", type);
    sending.upload.onprogress = ({ loaded, total }) => progress(loaded / total);
    sending.onload = () => {
      const { status, responseText } = sending;
      const ok = status >= 200 && status < 300;
      resolve({ ok, status, reason: ok ? "" : reasonOf(status, responseText) });
    };
    sending.onerror = () => resolve({
      ok: false, status: 0, reason: "the service ended the upload: it does not run, or the file is too large for it",
    });
    sending.send(bytes);
  });
}
