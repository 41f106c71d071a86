// STOP: an element, a layer and a script of its own, so that nothing else on the page can cover it,
// swallow its presses or break it.
(() => {
  // Not confirmed within the deadline: the alarm. It is tried again for a while; a stop that comes
  // much later would stop something else.
  const DEADLINE_MS = 500, AGAIN_MS = 250, PATIENCE_MS = 1000, GIVES_UP_MS = 10000, SHOWN_MS = 4000, CLICK_MS = 1000;
  const layer = document.getElementById("stop-layer"), button = document.getElementById("stop");
  const state = document.getElementById("stop-state"), failed = document.getElementById("stop-failed");
  const idle = state.textContent, pause = (ms) => new Promise((done) => setTimeout(done, ms));
  // A page that was away for long loads itself again: what it could not deliver outlives that.
  const owed = window.sessionStorage, OWED = "palpate-stop";
  let pressed = null, back = 0, down = -Infinity;

  function say(kind, words) {
    button.dataset.state = kind;
    state.textContent = words;
    failed.hidden = kind !== "failed";
  }

  async function delivered() {
    try {
      const reply = await fetch("/stop", { method: "POST", keepalive: true, cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
      return reply.ok && (await reply.json()).stopped === true;
    } catch {
      return false;
    }
  }

  function confirmed(press) {
    if (press.confirmed) return;
    press.confirmed = true;
    owed.removeItem(OWED);
    clearTimeout(press.alarm);
    if (pressed === press) pressed = null;
    const after = performance.now() - press.at;
    say("confirmed", `${button.dataset.confirmed} ${after < 1000 ? `${Math.round(after)} ms` : `${(after / 1000).toFixed(1)} s`}`);
    back = setTimeout(() => say("idle", idle), SHOWN_MS);
  }

  async function send(press) {
    while (!press.confirmed && performance.now() - press.at < GIVES_UP_MS) {
      if (await delivered()) confirmed(press);
      else await pause(AGAIN_MS);
    }
    if (press.confirmed) return;
    if (pressed === press) pressed = null;
    giveUp();
  }

  function giveUp() {
    say("failed", button.dataset.failed);
  }

  function stop() {
    // Whoever presses again and again must not put off the alarm.
    if (pressed) {
      const waiting = pressed;
      delivered().then((done) => done && confirmed(waiting));
      return;
    }
    const press = { at: performance.now(), confirmed: false };
    press.alarm = setTimeout(() => say("failed", button.dataset.trying), DEADLINE_MS);
    clearTimeout(back);
    pressed = press;
    owed.setItem(OWED, Date.now());
    say(failed.hidden ? "sent" : "failed", button.dataset.sent);
    send(press);
  }

  const since = owed.getItem(OWED);
  if (since !== null && Date.now() - since < GIVES_UP_MS) stop();
  else if (since !== null) giveUp();

  // On press, not on release: a finger that slides off, a palm and a second finger stop too. Caught
  // before anything else on the page hears of it, and whatever lies over the button.
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
    const heard = event.detail > 0 && performance.now() - down < CLICK_MS;
    if (!(heard ? onStop(event) : button.contains(event.target))) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    // Without a press it comes from the keyboard or a screen reader.
    if (!heard) stop();
  }, true);
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  window.addEventListener("keydown", (event) => { if (event.key === "Escape" && !event.repeat) stop(); }, true);

  // Zoomed in by two fingers, or with the keyboard on the screen: where the eye is.
  function follow() {
    const view = window.visualViewport, moved = view.scale > 1.01 || view.height < window.innerHeight - 1;
    layer.style.cssText = moved
      ? `inset: 0 auto auto 0; transform-origin: 0 0; width: ${view.width * view.scale}px; height: ${view.height * view.scale}px; transform: translate(${view.offsetLeft}px, ${view.offsetTop}px) scale(${1 / view.scale})`
      : "";
  }
  window.visualViewport.addEventListener("resize", follow);
  window.visualViewport.addEventListener("scroll", follow);
})();
