// STOP has a separate element, layer and script, so that no other part of the page can cover the
// button, intercept its presses or break it.
(() => {
  // Without a confirmation before the deadline, the page shows an alarm. The stop is repeated for a
  // limited time, because a much later stop would affect another job.
  const DEADLINE_MS = 500, RETRY_MS = 250, TIMEOUT_MS = 1000, MAX_RETRY_MS = 10000, SHOWN_MS = 4000, CLICK_MS = 1000;
  const layer = document.getElementById("stop-layer"), button = document.getElementById("stop");
  const state = document.getElementById("stop-state"), failed = document.getElementById("stop-failed");
  const idle = state.textContent, pause = (ms) => new Promise((done) => setTimeout(done, ms));
  // The page reloads itself after a long network failure; the session storage preserves a pending stop.
  const storage = window.sessionStorage, PENDING_KEY = "palpate-stop";
  let pressed = null, back = 0, down = -Infinity;

  function showState(kind, words) {
    button.dataset.state = kind;
    state.textContent = words;
    failed.hidden = kind !== "failed";
  }

  async function sendStop() {
    try {
      const reply = await fetch("/stop", { method: "POST", keepalive: true, cache: "no-store", signal: AbortSignal.timeout(TIMEOUT_MS) });
      return reply.ok && (await reply.json()).stopped === true;
    } catch {
      return false;
    }
  }

  function showConfirmed(press) {
    if (press.confirmed) return;
    press.confirmed = true;
    storage.removeItem(PENDING_KEY);
    clearTimeout(press.alarm);
    if (pressed === press) pressed = null;
    const after = performance.now() - press.at;
    showState("confirmed", `${button.dataset.confirmed} ${after < 1000 ? `${Math.round(after)} ms` : `${(after / 1000).toFixed(1)} s`}`);
    back = setTimeout(() => showState("idle", idle), SHOWN_MS);
  }

  async function send(press) {
    while (!press.confirmed && performance.now() - press.at < MAX_RETRY_MS) {
      if (await sendStop()) showConfirmed(press);
      else await pause(RETRY_MS);
    }
    if (press.confirmed) return;
    if (pressed === press) pressed = null;
    giveUp();
  }

  function giveUp() {
    showState("failed", button.dataset.failed);
  }

  function stop() {
    // Repeated presses must not postpone the alarm.
    if (pressed) {
      const waiting = pressed;
      sendStop().then((done) => done && showConfirmed(waiting));
      return;
    }
    const press = { at: performance.now(), confirmed: false };
    press.alarm = setTimeout(() => showState("failed", button.dataset.trying), DEADLINE_MS);
    clearTimeout(back);
    pressed = press;
    storage.setItem(PENDING_KEY, Date.now());
    showState(failed.hidden ? "sent" : "failed", button.dataset.sent);
    send(press);
  }

  // The alarm ends with the fault; the list of alarms keeps it.
  window.addEventListener("palpate-ready", () => {
    if (pressed || failed.hidden) return;
    storage.removeItem(PENDING_KEY);
    showState("idle", idle);
    window.emitEvent?.("stop_failed");
  });

  const since = storage.getItem(PENDING_KEY);
  if (since !== null && Date.now() - since < MAX_RETRY_MS) stop();
  else if (since !== null) giveUp();

  // Stops on press, not on release, so a sliding finger, a palm or a second finger also stops. The
  // event is captured before all other handlers, even if another element covers the button.
  function onStop(event) {
    const box = button.getBoundingClientRect();
    return event.clientX >= box.left && event.clientX < box.right && event.clientY >= box.top && event.clientY < box.bottom;
  }
  window.addEventListener("pointerdown", (event) => {
    if (!onStop(event)) return;
    event.stopImmediatePropagation();
    down = performance.now();
    stop();
  }, true);
  window.addEventListener("click", (event) => {
    const isSamePress = event.detail > 0 && performance.now() - down < CLICK_MS;
    if (!(isSamePress ? onStop(event) : button.contains(event.target))) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    // A click without a press comes from the keyboard or a screen reader.
    if (!isSamePress) stop();
  }, true);
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  window.addEventListener("keydown", (event) => { if (event.key === "Escape" && !event.repeat) stop(); }, true);

  // Keeps STOP in the visible part of the page during pinch zoom or with an on-screen keyboard.
  function follow() {
    const view = window.visualViewport, moved = view.scale > 1.01 || view.height < window.innerHeight - 1;
    layer.style.cssText = moved
      ? `inset: 0 auto auto 0; transform-origin: 0 0; width: ${view.width * view.scale}px; height: ${view.height * view.scale}px; transform: translate(${view.offsetLeft}px, ${view.offsetTop}px) scale(${1 / view.scale})`
      : "";
  }
  window.visualViewport.addEventListener("resize", follow);
  window.visualViewport.addEventListener("scroll", follow);
})();
