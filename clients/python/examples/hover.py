# %% [markdown]
# # How should a hawkmoth flap?
#
# A quick study from submission to optimum: 2000 strokes, a network, the stroke of least power.
# It needs a coordinator and a worker:
#
#     manduca serve &
#     manduca worker &
#
# Run it cell by cell, or as a whole: `python hover.py`. MANDUCA_COORDINATOR names another
# coordinator, MANDUCA_STUDY another study file.

# %%
"""A quick study from submission to optimum, with plots."""

import os
from pathlib import Path

import manduca

# A notebook has no __file__; it is then taken to run in the repository's folder.
ROOT = Path(__file__).resolve().parents[3] if "__file__" in globals() else Path()
FILE = os.environ.get("MANDUCA_STUDY") or ROOT / "studies" / "quick.toml"

# %% [markdown]
# Submit. With a key the cell may be run again: the same study is found, not flown twice.

# %%
client = manduca.Client()
study = client.submit(FILE, idempotency_key="examples/hover.py")
print(study)

# %% [markdown]
# Wait. Ctrl-C stops waiting, not the study.

# %%
study.wait()

# %% [markdown]
# The dataset has a row per stroke: ten parameters, four means in SI units and scaled, each
# with its standard error.

# %%
samples = study.dataset()
flown = samples[samples.outcome == "ok"]
print(flown[["frequency_hz", "sweep_amplitude_deg", "lift_n", "power_w"]].describe())

# %% [markdown]
# The optimum: least power P+ with L+ = 1, D+ = 0, M+ = 0.

# %%
optimum = study.optimum()
print(optimum)

# %% [markdown]
# What the network says of the sweep amplitude, all else as in the optimum, as far as there are samples.

# %%
low, high = flown.sweep_amplitude_deg.min(), flown.sweep_amplitude_deg.max()
sweeps = [low + (high - low) * i / 60 for i in range(61)]
predicted = study.predict([{**optimum.parameters, "sweep_amplitude_deg": sweep} for sweep in sweeps])

# %%
try:
    import matplotlib.pyplot as plt
except ImportError:
    print("no plots without matplotlib: pip install 'manduca[plot]'")
else:
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    points = left.scatter(flown.lift, flown.power, c=flown.frequency_hz, s=8)
    left.axvline(1, color="grey", linewidth=0.8)
    left.set(xlabel="lift L+", ylabel="power P+", title=f"{len(flown)} strokes")
    figure.colorbar(points, ax=left, label="frequency [Hz]")
    for output, label in (("power", "power P+"), ("lift", "lift L+")):
        right.plot(sweeps, [point[output] for point in predicted], label=label)
    right.axvline(optimum.parameters["sweep_amplitude_deg"], color="grey", linewidth=0.8)
    right.set(xlabel="sweep amplitude [°]", title="predicted around the optimum")
    right.legend()
    figure.savefig("hover.png", dpi=150)
    print("hover.png is written")
    plt.show()
