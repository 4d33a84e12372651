// Versions of a page without a server: kept for use without a network; a newer version is offered while no robot is connected.

import { computed, effect, signal } from "../html.js";
import { t } from "../texts/text.js";
import { hasBoard, welcome } from "./robot.js";
import { toast } from "./toasts.js";

/** The service worker of a newer version, which is ready. */
const newer = signal(/** @type {ServiceWorker | null} */ (null));
/** Whether nothing real can move, so that the page may be loaded again. */
const isFree = computed(() => !hasBoard.value || welcome.value?.is_virtual === true);
const STAYS = 2 ** 31 - 1; // milliseconds, the longest that browsers count

/** Keep this version in the browser, and offer a newer one. */
export async function followVersions() {
  const workers = navigator.serviceWorker;
  const isFirst = workers.controller === null;
  try {
    const registration = await workers.register("service-worker.js");
    navigator.storage.persist();
    if (isFirst) workers.ready.then(() => toast({ title: t("page.kept"), detail: t("page.kept_detail") }));
    const watch = (/** @type {ServiceWorker | null} */ worker) =>
      worker?.addEventListener("statechange", () => worker.state === "installed" && !isFirst && found(worker));
    registration.addEventListener("updatefound", () => watch(registration.installing));
    watch(registration.installing);
    if (registration.waiting) found(registration.waiting);
  } catch (error) {
    toast({ kind: "bad", title: t("page.not_kept"), detail: String(error) });
  }
}

/** @param {ServiceWorker} worker */
function found(worker) {
  newer.value = worker;
}

effect(() => {
  const worker = newer.value;
  if (worker === null || !isFree.value) return;
  const action = { label: t("page.load_newer"), run: () => load(worker) };
  toast({ name: "newer", title: t("page.newer"), detail: t("page.newer_detail"), lasts: STAYS, action });
});

/** Load the newer version of the page, unless a robot is connected or another window is open. @param {ServiceWorker} worker */
function load(worker) {
  if (!isFree.peek()) return toast({ kind: "bad", title: t("page.newer_robot") });
  const refused = new AbortController();
  const reload = () => location.reload();
  navigator.serviceWorker.addEventListener("controllerchange", reload, { once: true, signal: refused.signal });
  const { port1, port2 } = new MessageChannel();
  port1.onmessage = ({ data: isAlone }) => {
    if (isAlone) return;
    refused.abort();
    toast({ kind: "bad", title: t("page.newer_windows") });
  };
  return worker.postMessage("replace", [port2]);
}
