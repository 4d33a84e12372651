// Files of Python that outlast the page: files synchronized by a program (`os.fsync`) are there at the next visit.
//
// `fsync` cannot wait for the browser, which writes without a promise only to open files of its private file system. Two such
// files are logs of changes, of which the later generation is valid. A long log is replaced by the other file, with the present
// content; the entry with the next generation comes last. The tab may end at each byte.

/** @typedef {{ getSize: () => number, read: (to: Uint8Array, where: { at: number }) => number, write: (from: Uint8Array, where: { at: number }) => number, truncate: (size: number) => void, flush: () => void }} Store a FileSystemSyncAccessHandle */
/** @typedef {{ path: string, mode: number } | { gone: string } | { generation: number }} Entry */
/** @typedef {{ mode: number, content: Uint8Array }} KeptFile */

const END = 0x5e41_11ed;
const NUMBERS = 12; // bytes of an entry beside head and content: their sizes in front, and `END` behind
const LONG = 4 * 1024 * 1024; // bytes of a log that is written anew where four of five bytes are of the past
const TEMPORARY = /^\.servolink-/; // of a file that is being written
const TRIES = 30,
  PAUSE = 100; // milliseconds, while a page that was left still has the files
const NO_SPACE = 51; // number of the error ENOSPC in Emscripten

/** Content and permissions of the files of a folder, by path, read from the valid log and changed together with the log. */
export class KeptLog {
  /** @param {[Store, Store]} stores */
  constructor(stores) {
    this._stores = stores;
    const logs = stores.map(readLog);
    this._used = logs[1].generation > logs[0].generation ? 1 : 0;
    /** @type {Map<string, KeptFile>} */
    this.files = logs[this._used].files;
    this._generation = logs[this._used].generation;
    this._end = logs[this._used].end;
    if (this._generation === 0) this._begin();
    else stores[this._used].truncate(this._end);
  }

  /** Keep a file, with null delete the file; on the disk after `flush`. @param {string} path @param {KeptFile | null} file */
  put(path, file) {
    if (file) this.files.set(path, file);
    else this.files.delete(path);
    this._append(file ? { path, mode: file.mode } : { gone: path }, file?.content);
  }

  flush() {
    this._stores[this._used].flush();
    const live = [...this.files.values()].reduce((sum, { content }) => sum + content.length, 0);
    if (this._end > LONG && this._end > 5 * live) this._begin();
  }

  /** Write the present content of all files to the other store, make the other store the valid log, and empty the old log. */
  _begin() {
    const old = this._used;
    this._used = 1 - old;
    this._end = 0;
    this._stores[this._used].truncate(0);
    for (const [path, { mode, content }] of this.files) this._append({ path, mode }, content);
    this._stores[this._used].flush(); // before the entry that makes it valid
    this._append({ generation: ++this._generation });
    this._stores[this._used].flush();
    this._stores[old].truncate(0);
  }

  /** @param {Entry} entry @param {Uint8Array} [content] */
  _append(entry, content = new Uint8Array()) {
    const head = new TextEncoder().encode(JSON.stringify(entry));
    const bytes = new Uint8Array(NUMBERS + head.length + content.length);
    const numbers = new DataView(bytes.buffer);
    numbers.setUint32(0, head.length);
    numbers.setUint32(4, content.length);
    bytes.set(head, 8);
    bytes.set(content, 8 + head.length);
    numbers.setUint32(bytes.length - 4, END);
    const written = this._stores[this._used].write(bytes, { at: this._end });
    if (written !== bytes.length) throw new Error("the browser has no room left");
    this._end += bytes.length;
  }
}

/** Read a log up to the last whole entry; generation 0 for an invalid log. @param {Store} store */
function readLog(store) {
  const bytes = new Uint8Array(store.getSize());
  store.read(bytes, { at: 0 });
  const numbers = new DataView(bytes.buffer);
  /** @type {Map<string, KeptFile>} */
  const files = new Map();
  let generation = 0,
    end = 0;
  while (end + NUMBERS <= bytes.length) {
    const content = end + 8 + numbers.getUint32(end),
      last = content + numbers.getUint32(end + 4);
    if (last + 4 > bytes.length || numbers.getUint32(last) !== END) break;
    const entry = JSON.parse(new TextDecoder().decode(bytes.subarray(end + 8, content)));
    if (entry.generation) generation = entry.generation;
    else if (entry.gone) files.delete(entry.gone);
    else files.set(entry.path, { mode: entry.mode, content: bytes.slice(content, last) });
    end = last + 4;
  }
  return { files, generation, end };
}

/** Open the two stores of this browser. Rejects while another page uses the stores, and in browsers without private files. @returns {Promise<[Store, Store]>} */
export async function openStores() {
  const folder = await navigator.storage.getDirectory();
  /** @param {string} name @returns {Promise<Store>} */
  const open = async (name, left = TRIES) => {
    const file = /** @type {any} */ (await folder.getFileHandle(name, { create: true }));
    try {
      return await file.createSyncAccessHandle();
    } catch (error) {
      if (left === 0 || /** @type {Error} */ (error).name !== "NoModificationAllowedError") throw error;
      await new Promise((resolve) => setTimeout(resolve, PAUSE));
      return open(name, left - 1);
    }
  };
  return [await open("servolink-0"), await open("servolink-1")];
}

/**
 * Keep the files of a new folder of Python's file system in a log: at once when a program synchronizes a file or a folder,
 * otherwise in the next turn of the worker.
 * @param {any} FS of Emscripten
 * @param {string} folder
 * @param {KeptLog} log
 * @param {(error: unknown) => void} fail called for changes without `fsync` that cannot be kept
 * @param {(work: () => void) => void} [later] schedules work for the next turn
 */
export function keepFolder(FS, folder, log, fail, later = setTimeout) {
  const memory = FS.filesystems.MEMFS;
  FS.mkdirTree(folder, 0o700);
  FS.mount(memory, {}, folder);
  for (const [path, { mode, content }] of log.files) {
    FS.mkdirTree(path.slice(0, path.lastIndexOf("/")), 0o700);
    FS.writeFile(path, content);
    FS.chmod(path, mode);
  }
  /** Number of changes of each file. @type {WeakMap<object, number>} */
  const changes = new WeakMap();
  /** @type {(path: string, found: Map<string, any>) => Map<string, any>} */
  const list = (path, found) => {
    const { node } = FS.lookupPath(path);
    if (FS.isFile(node.mode)) return found.set(path, node);
    for (const name of FS.readdir(path))
      if (name !== "." && name !== ".." && !TEMPORARY.test(name)) list(`${path}/${name}`, found);
    return found;
  };
  /** @param {any} node */
  const stateOf = (node) => ({ node, changes: changes.get(node) });
  let known = new Map([...list(folder, new Map())].map(([path, node]) => [path, stateOf(node)]));
  let isPlanned = false;

  const synchronize = () => {
    const found = list(folder, new Map());
    for (const path of known.keys()) if (!found.has(path)) log.put(path, null);
    for (const [path, node] of found) {
      const before = known.get(path);
      if (before && before.node === node && before.changes === changes.get(node)) continue;
      log.put(path, { mode: node.mode & 0o7777, content: FS.readFile(path) });
    }
    known = new Map([...found].map(([path, node]) => [path, stateOf(node)]));
    log.flush();
  };
  /** @param {any} node */
  const isHere = (node) => node.mount.mountpoint === folder;
  /** @param {any} node */
  const note = (node) => {
    if (!isHere(node)) return;
    changes.set(node, (changes.get(node) ?? 0) + 1);
    if (isPlanned) return;
    isPlanned = true;
    later(() => {
      isPlanned = false;
      try {
        synchronize();
      } catch (error) {
        fail(error);
      }
    });
  };
  const { file, dir } = memory.ops_table;
  for (const operations of [file.stream, dir.stream]) {
    const others = operations.fsync ?? (() => 0); // the function for another kept folder
    operations.fsync = (/** @type {any} */ stream) => {
      if (!isHere(stream.node)) return others(stream);
      try {
        synchronize();
      } catch {
        throw new FS.ErrnoError(NO_SPACE);
      }
      return 0;
    };
  }
  /** @type {[any, string[]][]} */
  const changing = [
    [file.stream, ["write"]],
    [file.node, ["setattr"]],
    [dir.node, ["mknod", "rename", "unlink"]],
  ];
  for (const [operations, names] of changing)
    for (const name of names) {
      const real = operations[name];
      operations[name] = (/** @type {any[]} */ ...args) => {
        const result = real(...args);
        note(args[0].node ?? args[0]);
        return result;
      };
    }
}
