// Service worker of a page without a server: keeps all files of the page in the browser, answers from there with or without a
// network, and adds the policy. The build puts a line in front of this module that sets `BUILD`. Files are kept by path and
// checksum: a new version fetches only different files, and the old version stays whole until all windows are closed.

/** @typedef {{ files: Record<string, string>, headers: Record<string, string> }} Build checksums, SHA-256 in Base64, by path */

const worker = /** @type {any} */ (self);
/** @type {Build} */
const { files, headers } = worker.BUILD;
const SCOPE = worker.registration.scope;
const CACHE = `servolink ${SCOPE}`;

/** @param {string} path */
const keyOf = (path) => `${new URL(path, SCOPE)}?${files[path]}`;

/** Fetch a file of this version; fails for any other bytes. @param {string} path */
const fetched = (path) => fetch(new URL(path, SCOPE), { cache: "no-cache", integrity: `sha256-${files[path]}` });

async function keepFiles() {
  const cache = await caches.open(CACHE);
  const kept = new Set((await cache.keys()).map(({ url }) => url));
  await Promise.all(
    Object.keys(files).map(async (path) => {
      if (!kept.has(keyOf(path))) await cache.put(keyOf(path), await fetched(path));
    }),
  );
}

async function leaveOldVersions() {
  const cache = await caches.open(CACHE);
  const wanted = new Set(Object.keys(files).map(keyOf));
  const old = (await cache.keys()).filter(({ url }) => !wanted.has(url));
  await Promise.all(old.map((request) => cache.delete(request)));
  await worker.clients.claim();
}

/** Return a response with the content of a kept file, its type, and the headers of the policy. @param {string} path */
async function answer(path) {
  const { body, headers: given } = (await caches.match(keyOf(path), { cacheName: CACHE })) ?? (await fetched(path));
  return new Response(body, { headers: { ...headers, "Content-Type": given.get("Content-Type") ?? "" } });
}

/** Replace the previous version unless several windows are open; answer the window with true or false. @param {MessagePort} port */
async function replaceVersion(port) {
  const windows = await worker.clients.matchAll({ includeUncontrolled: true });
  const isAlone = windows.filter((/** @type {{ url: string }} */ { url }) => url.startsWith(SCOPE)).length <= 1;
  port.postMessage(isAlone);
  if (isAlone) await worker.skipWaiting();
}

worker.addEventListener("install", (/** @type {any} */ event) => event.waitUntil(keepFiles()));
worker.addEventListener("activate", (/** @type {any} */ event) => event.waitUntil(leaveOldVersions()));
worker.addEventListener("message", (/** @type {any} */ event) => event.waitUntil(replaceVersion(event.ports[0])));
worker.addEventListener("fetch", (/** @type {any} */ event) => {
  const { origin, pathname } = new URL(event.request.url);
  if (event.request.method !== "GET" || !`${origin}${pathname}`.startsWith(SCOPE)) return;
  const path = pathname.slice(new URL(SCOPE).pathname.length) || "index.html";
  if (path in files) event.respondWith(answer(path));
});
