// A screen that stays on, where the browser lets a page ask for that: over https, or on this machine.
let lock = null;

async function stayAwake() {
  if (document.visibilityState !== "visible" || !navigator.wakeLock || (lock && !lock.released)) return;
  try {
    lock = await navigator.wakeLock.request("screen");
    document.body.dataset.awake = true;
    lock.addEventListener("release", () => delete document.body.dataset.awake);
  } catch {
    // The battery is low, or the page was hidden again: the next look at it asks again.
  }
}

export function begin() {
  if (!new URLSearchParams(location.search).has("kiosk")) return;
  // A lock ends whenever the page is hidden.
  document.addEventListener("visibilitychange", stayAwake);
  document.addEventListener("contextmenu", (event) => event.preventDefault());
  stayAwake();
}
