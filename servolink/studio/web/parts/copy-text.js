// Copying to the clipboard of the system.

/**
 * Copy a text. Return whether the browser has taken it.
 * @param {string} text
 */
export async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    // Browsers have this clipboard only for pages of this machine or with TLS; the event comes on every page.
    const fill = (/** @type {ClipboardEvent} */ event) => {
      event.clipboardData?.setData("text/plain", text);
      event.preventDefault();
    };
    addEventListener("copy", fill);
    const isCopied = document.execCommand("copy");
    removeEventListener("copy", fill);
    return isCopied;
  }
}
