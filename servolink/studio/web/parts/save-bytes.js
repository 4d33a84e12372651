// Saves a file, as a browser saves what it downloads.

/**
 * @param {string} name
 * @param {string} type
 * @param {BlobPart[]} parts
 */
export function saveBytes(name, type, parts) {
  const url = URL.createObjectURL(new Blob(parts, { type }));
  const anchor = document.createElement("a");
  anchor.href = url;
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(url), 0);
}
