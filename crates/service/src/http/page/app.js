// The page: which view is shown, the token, and the connection that the live view has.

import { Jobs } from "./jobs.js";
import { Live } from "./live.js";
import { request } from "./http.js";

const $ = (id) => document.getElementById(id);

let live = null;
let jobs = null;
let liveScene = null;

/** The hash names the view and, of a live view, the scene: `#live`, `#live=ID`, `#jobs`. */
function route() {
  const [name, scene] = location.hash.slice(1).split("=");
  const isJobs = name === "jobs";
  $("live").hidden = isJobs;
  $("jobs").hidden = !isJobs;
  for (const [id, is] of [["to-live", !isJobs], ["to-jobs", isJobs]]) {
    if (is) $(id).setAttribute("aria-current", "page");
    else $(id).removeAttribute("aria-current");
  }
  if (isJobs) {
    jobs ??= new Jobs();
    jobs.watch();
  } else {
    jobs?.rest();
    watch(scene ?? "");
  }
}

/** Opens the live view of a scene; without a name, of the service's own scene or of the newest one. */
function watch(scene) {
  if (live && liveScene === scene) return;
  live?.close();
  liveScene = scene;
  const url = new URL("api/v1/live", location.href);
  url.protocol = url.protocol.replace("http", "ws");
  url.hash = "";
  if (scene) url.searchParams.set("scene", scene);
  live = new Live(url, (reason) => {
    live = null;
    if (scene) return;
    // No scene was asked for, and there is none that can be shown: jobs are where one comes from.
    location.hash = "jobs";
    jobs ??= new Jobs();
    jobs.tell(reason);
  });
}

/** Asks for the token until it is right. */
function enter() {
  return new Promise((resolve) => {
    const dialog = $("token-dialog");
    dialog.addEventListener("cancel", (event) => event.preventDefault());
    $("token-form").addEventListener("submit", async (event) => {
      event.preventDefault();
      const answer = await request("POST", "session", { json: { token: $("token").value.trim() } });
      $("token-error").hidden = answer.ok;
      $("token-error").textContent = answer.ok ? "" : answer.reason;
      if (!answer.ok) return $("token").select();
      dialog.close();
      resolve();
    });
    dialog.showModal();
  });
}

async function start() {
  // The address that the service prints has the token after `#`, which browsers send to no one.
  const given = location.hash.match(/^#token=([0-9a-f]+)$/);
  if (given) {
    history.replaceState(null, "", location.pathname);
    await request("POST", "session", { json: { token: given[1] } });
  }
  const answer = await request("GET", "jobs?limit=1");
  if (answer.status === 401) await enter();
  addEventListener("hashchange", route);
  route();
}

start();
