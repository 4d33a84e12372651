// Runs `main` of a Python file of this repository in Pyodide: node runner.mjs FILE [ARGUMENT...]
import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import process from "node:process";
import { fileURLToPath } from "node:url";
import { loadPyodide } from "pyodide";
import { keepFolder, KeptLog } from "../../servolink/studio/web/worker/kept-files.js";
import { Store } from "./store.mjs";

const RUN = `
import inspect, runpy, sys, traceback, warnings

def run(root, file, arguments):
    sys.path.insert(0, root)
    sys.argv = [file, *arguments]
    warnings.simplefilter("error")
    with Ended() as ended:
        result = runpy.run_path(file)["main"]()
        if inspect.isawaitable(result):
            return finish(result) # in a task, while main itself is in none and may run a loop of its own
        sys.exit(result)
    return ended.code

async def finish(result):
    with Ended() as ended:
        sys.exit(await result)
    return ended.code

class Ended:
    def __enter__(self):
        return self

    def __exit__(self, kind, error, _):
        if not isinstance(error, SystemExit | None):
            traceback.print_exception(error)
        code = getattr(error, "code", 1)
        if isinstance(code, str):
            print(code, file=sys.stderr)
        self.code = code if isinstance(code, int) else int(code is not None)
        return True

run
`;

const here = dirname(fileURLToPath(import.meta.url));
const root = resolve(here, "../..");
const wheels = join(here, "wheels");
const [file, ...options] = process.argv.slice(2);
try {
  const pyodide = await loadPyodide({ env: { PYTHONDONTWRITEBYTECODE: "1" } });
  pyodide.FS.mkdirTree(root); // the same path as here, for tracebacks; all other files of the program are in memory
  pyodide.mountNodeFS(root, root);
  for (const wheel of readdirSync(wheels)) {
    pyodide.unpackArchive(new Uint8Array(readFileSync(join(wheels, wheel))), "wheel");
  }
  pyodide.registerJsModule("browser", {
    newStores: () => [new Store({ left: Infinity }), new Store({ left: Infinity })],
    copyOf: (stores) => stores.map(({ bytes }) => new Store({ left: Infinity }, bytes.slice())),
    /** Mount a folder that is kept in stores, with the files that they have of it, or of the folder `origin`. */
    keep: (folder, stores, origin = folder) => {
      const log = new KeptLog(stores);
      log.files = new Map([...log.files].map(([path, file]) => [path.replace(origin, folder), file]));
      // The next turn never comes: what a program has synchronized is kept without it.
      keepFolder(pyodide.FS, folder, log, () => {}, () => {});
    },
  });
  process.exit(await pyodide.runPython(RUN)(root, resolve(file), options));
} catch (error) {
  console.error(error.message); // without the line of Pyodide that raised it, of a megabyte
  process.exit(1);
}
