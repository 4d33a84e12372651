// Starts the page of a folder without a server: never in a frame, and kept in the browser for use without a network.

import { effect } from "./html.js";
import { unkept } from "./state/loading.js";
import { welcome } from "./state/robot.js";
import { showLanguage } from "./state/settings.js";
import { toast } from "./state/toasts.js";
import { followVersions } from "./state/versions.js";
import { t } from "./texts/text.js";

const LASTS = 60_000; // milliseconds that a sentence stays on the screen

/** Refuse to start in a frame, where the surrounding page could lead people to press STOP or move buttons unknowingly. */
async function refuseFrame() {
  await showLanguage();
  const link = document.createElement("a");
  link.href = location.pathname;
  link.target = "_blank";
  link.rel = "noopener";
  link.textContent = t("page.framed");
  document.body.replaceChildren(link);
}

async function begin() {
  await import("./app.js");
  effect(() => {
    if (unkept.value) toast({ kind: "bad", title: t("page.unkept"), detail: unkept.value, lasts: LASTS });
  });
  if (!isSecureContext)
    return toast({ kind: "bad", title: t("page.insecure"), detail: t("page.insecure_detail"), lasts: LASTS });
  const end = effect(() => {
    // The first visit loads the page before it keeps it.
    if (!welcome.value) return;
    queueMicrotask(() => end());
    followVersions();
  });
}

await (window.top === window ? begin() : refuseFrame());
