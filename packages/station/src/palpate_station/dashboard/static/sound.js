// A tone for a finished grasp and a tone for a fault, for users who do not watch the screen. The sound
// is off until the button is pressed; the browser stores this setting.
const STORAGE_KEY = "palpate-sound";
// The tones differ in pitch, duration and waveform, so each is recognizable by itself.
const TONES = { done: { hz: 880, s: 0.25, shape: "sine" }, fault: { hz: 220, s: 0.9, shape: "square" } };
const LOUDNESS = 0.3, EDGE_S = 0.02;
// Time from the end of a scan until the server has checked the label: usual and maximum. While it is typed,
// a name that the second scan confirms is still refused.
const CHECK_MS = 300, CHECKED_MS = 3000;
let context = null, before = null, alarms = null, scannedAt = -Infinity;

const wanted = () => localStorage.getItem(STORAGE_KEY) === "on";

// Browsers allow sound only after a user interaction.
function wake() {
  if (!wanted()) return;
  context ??= new AudioContext();
  if (context.state === "suspended") context.resume();
}

function play(name) {
  if (!wanted() || !context) return;
  const { hz, s, shape } = TONES[name], tone = context.createOscillator(), gain = context.createGain(), now = context.currentTime;
  tone.type = shape;
  tone.frequency.value = hz;
  gain.gain.setValueAtTime(0, now);
  gain.gain.linearRampToValueAtTime(LOUDNESS, now + EDGE_S);
  gain.gain.setValueAtTime(LOUDNESS, now + s - EDGE_S);
  gain.gain.linearRampToValueAtTime(0, now + s);
  tone.connect(gain).connect(context.destination);
  tone.start(now);
  tone.stop(now + s);
}

function show() {
  const button = document.getElementById("sound");
  if (!button || button.ariaPressed === String(wanted())) return;
  button.ariaPressed = wanted();
  button.firstElementChild.textContent = wanted() ? "volume_up" : "volume_off";
}

export function begin() {
  // Enter ends a scan; the server then marks the field of a damaged label.
  document.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && event.target.matches?.("input.scanned")) scannedAt = performance.now();
  }, true);
  document.addEventListener("pointerdown", wake, true);
  document.addEventListener("keydown", wake, true);
  document.addEventListener("click", (event) => {
    if (!event.target.closest?.("#sound")) return;
    localStorage.setItem(STORAGE_KEY, wanted() ? "off" : "on");
    show();
    wake();
    if (wanted()) play("done");
  });
}

// Plays the tone of a fault.
export const warn = () => play("fault");

// Plays a tone on changes only, not for the state at loading.
export function sound(kind, alarmCount = alarms) {
  show();
  const isAlarm = alarms !== null && alarmCount > alarms;
  alarms = alarmCount;
  const sinceMs = performance.now() - scannedAt;
  if (sinceMs > CHECK_MS && sinceMs < CHECKED_MS && document.querySelector(".refused")) {
    scannedAt = -Infinity;
    play("fault");
  }
  if (isAlarm && kind !== "bad" && kind !== "lost") play("fault");
  else if (before !== null && kind !== before) {
    if (kind === "lost" || (kind === "bad" && before !== "lost")) play("fault");
    else if (before === "busy" && (kind === "good" || kind === "warn")) play("done");
  }
  before = kind;
}
