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

async def run(root, file, arguments):
    sys.path.insert(0, root)
    sys.argv = [file, *arguments]
    warnings.simplefilter("error")
    try:
        result = runpy.run_path(file)["main"]()
        sys.exit(await result if inspect.isawaitable(result) else result)
    except SystemExit as ended:
        if isinstance(ended.code, str):
            print(ended.code, file=sys.stderr)
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1

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
