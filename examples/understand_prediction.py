"""Four figures on the limits of a single exponential, in the form of a notebook.

    python examples/understand_prediction.py pictures

All holds are simulated as sums of decays, which is also the model of `relaxation` and favours it.
Results on real recordings are in docs/results.md.
"""

# %%
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import palpate

HORIZON_S = 20.0
METHODS = {"recorded": "#8A8A8A", "exponential": "#D55E00", "relaxation": "#0072B2"}
OUT = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
OUT.mkdir(parents=True, exist_ok=True)


def save(figure: Figure, name: str, caption: str) -> None:
    figure.savefig(OUT / name, dpi=120)
    print(f"{OUT / name}: {caption}")


# %% The resistance of a sheet under constant load keeps falling, with time constants from
# hundredths of a second to minutes. The drawn holds have thirteen decays with random weights.
chance = np.random.default_rng(20)
time_s = np.arange(0.0, 20.5, 1 / 15)
tau_s = np.geomspace(0.1, 200.0, 13)
weights = chance.gamma(2.0, 0.5, size=(60, 13))
decays = np.exp(-time_s[:, None] / tau_s)
holds = 100 + 3.0 * weights @ decays.T + chance.normal(0, 0.05, size=(60, time_s.size))
settled = holds[:, (time_s > 19.5) & (time_s <= HORIZON_S)].mean(axis=1)

# %% One hold, and the predictions from its first seconds. The exponential fits only the decays in
# the window, so its prediction decreases as the window grows.
figure = Figure(figsize=(9, 3.2), layout="constrained")
for axes, cutoff_s in zip(figure.subplots(1, 3, sharey=True), (1.0, 2.5, 5.0), strict=True):
    used = time_s <= cutoff_s
    axes.plot(time_s, holds[0], color="#C8C8C8")
    axes.plot(time_s[used], holds[0][used], color="#222222")
    for x, (name, color) in zip((18.6, 19.5, 20.4), METHODS.items(), strict=True):
        answer = palpate.predict_settled(time_s, holds[0], cutoff_s=cutoff_s, method=name)
        low, high = answer.value - answer.low, answer.high - answer.value
        bars = [[low], [high]] if np.isfinite([low, high]).all() else None
        axes.errorbar([x], [answer.value], yerr=bars, fmt="o", color=color, capsize=3, label=name)
    axes.set(title=f"cut-off {cutoff_s:g} s", xlabel="time, s")
figure.axes[0].set_ylabel("resistance, ohm (simulated)")
figure.axes[0].legend(frameon=False, fontsize=8)
save(figure, "1-one-hold.png", "black: samples used; grey: later samples")

# %% All sixty holds: error at the horizon over the waiting time.
cutoffs_s = (1.0, 1.5, 2.5, 5.0, 10.0)
figure = Figure(figsize=(6, 3.6), layout="constrained")
axes = figure.subplots()
for name, color in METHODS.items():
    errors = []
    for cutoff_s in cutoffs_s:
        answer = palpate.predict_settled(time_s, holds, cutoff_s=cutoff_s, method=name)
        errors.append(np.median(np.abs(answer.value / settled - 1)) * 100)
    axes.plot(cutoffs_s, errors, "o-", color=color, label=name)
    print(f"  {name}: " + ", ".join(f"{e:.2f} %" for e in errors))
axes.set(xlabel="cut-off, s", ylabel="median |error|, % of settled", xscale="log", ylim=(0, None))
axes.set_xticks(cutoffs_s, [f"{c:g}" for c in cutoffs_s])
axes.legend(frameon=False)
save(figure, "2-error-against-waiting.png", "sixty simulated holds")

# %% Each prediction has an interval, which narrows over time. A gripper can therefore decide as
# soon as the interval is narrow enough, instead of after a fixed time.
grid_s = np.arange(0.6, 12.0, 0.4)
answers = [palpate.predict_settled(time_s, holds[1], cutoff_s=c) for c in grid_s]
figure = Figure(figsize=(6, 3.6), layout="constrained")
axes = figure.subplots()
axes.plot(time_s, holds[1], color="#C8C8C8", label="the hold")
low, high = [a.low for a in answers], [a.high for a in answers]
axes.fill_between(grid_s, low, high, color="#0072B2", alpha=0.2, label="90 % interval")
axes.plot(grid_s, [a.value for a in answers], color="#0072B2", label="predicted for 20 s")
axes.axhline(settled[1], color="#222222", linewidth=0.8, linestyle="--", label="settled")
axes.set(xlabel="seen so far, s", ylabel="resistance, ohm (simulated)", ylim=(95, 130))
axes.legend(frameon=False, fontsize=8)
save(figure, "3-the-band-narrows.png", "repeated predictions of one hold")

# %% Coverage of the 90 % interval over the sixty holds at each waiting time.
figure = Figure(figsize=(6, 3.2), layout="constrained")
axes = figure.subplots()
coverage = []
for cutoff_s in cutoffs_s:
    answer = palpate.predict_settled(time_s, holds, cutoff_s=cutoff_s)
    coverage.append(np.mean((answer.low <= settled) & (settled <= answer.high)))
axes.plot(cutoffs_s, coverage, "o-", color="#0072B2")
axes.axhline(0.9, color="#222222", linewidth=0.8, linestyle="--")
axes.set(xlabel="cut-off, s", ylabel="coverage", ylim=(0, 1.02), xscale="log")
axes.set_xticks(cutoffs_s, [f"{c:g}" for c in cutoffs_s])
save(figure, "4-coverage.png", "dashed: nominal coverage; below it the intervals are too narrow")
