// Python in a worker: Pyodide with the packages of the build, whose `files.json` says how much is loaded.

const PACKAGES = "/lib/python3.14/site-packages";
const RUNTIME = ["pyodide.asm.wasm", "python_stdlib.zip"];
const here = new URL("../python/", import.meta.url);
const runtime = new URL("runtime/", here);

/** Return the bytes of a file, telling how many have come. @param {URL} url @param {(bytes: number) => void} tell */
async function load(url, tell) {
  const response = await fetch(url);
  if (!response.ok || !response.body) throw new Error(`${url.pathname}: ${response.status}`);
  const parts = [];
  const reader = response.body.getReader();
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    parts.push(part.value);
    tell(part.value.length);
  }
  return new Blob(parts).arrayBuffer();
}

/**
 * Start Python. Rejects if a file does not come.
 * @param {{ [name: string]: string }} env
 * @param {(now: import("../state/loading.js").Loading) => void} tell
 */
export async function startPython(env, tell) {
  const { bytes: total } = await (await fetch(new URL("files.json", here))).json();
  let loaded = 0;
  const more = (/** @type {number} */ bytes) => tell({ loaded: (loaded += bytes), total });
  const [packages] = await Promise.all([
    load(new URL("packages.zip", here), more),
    ...RUNTIME.map((name) => load(new URL(name, runtime), more)), // so that the browser has them in its cache
  ]);
  const { loadPyodide } = await import(new URL("pyodide.mjs", runtime).href);
  const python = await loadPyodide({ indexURL: runtime.href, env });
  python.FS.mkdirTree(env.XDG_RUNTIME_DIR, 0o700);
  python.unpackArchive(packages, "zip", { extractDir: PACKAGES });
  return python;
}
