"""The studies of `palpate study` and the benchmarks of `palpate bench`."""

from __future__ import annotations

#: Study -> description. The module has the study's name and defines the function `command`.
_STUDY_TEXTS = {
    "force-ladders": "Dead weights on real Velostat, held-out sensors",
    "import-data": "Tables of real recordings from clones of the public repositories",
    "force-population": "Constants of the force law, learned from all real sensors",
    "force-control": "Random objects gripped to a force and lifted, simulated",
    "grasp-cycle": "Time to contact and to the answer, damage and accuracy of a grasp, simulated",
    "faults": "Single faults in every phase of a grasp, simulated",
    "harvest": "Pull verdicts at 1 to 10 N on held fruit compared with the truth, simulated",
    "noise": "Filters against mains pick-up and motor spikes, on the twin",
    "qualify": "Agreement with a penetrometer: 720 real apples, and simulated ones on the twin",
    "presses": "Current force on real Velostat during robot presses",
    "soft-sensor": "Force of a microfluidic soft sensor, held-out depths, real recordings",
    "hydrogel": "Force of a real hydrogel sensor in a robot's force loop, held-out recordings",
    "strokes": "Force of real Velostat touched by pins, held-out sensors",
    "ripeness": "Stages and days to ripe of avocados on the twin",
    "fruit-grip": "Real fruit gripped by the simulated hand, with a damage limit or a fixed cap",
    "rupture": "Stopping before rupture when closing on real fruit",
    "realism": "The twin's scatter compared with real recordings",
    "bruise": "Bruised and sound apples, simulated",
    "detection-limit": "Weakest detectable force and linearity, on the twin",
    "environment": "Figures 1b and 3, climate and suction on the twin",
    "fatigue": "Figure 4, 2 500 cycles on the twin",
    "size": "Figure 14, size of strawberries in 1 mm steps, simulated",
    "slip": "Slip and removal: detection rates, false alarms, delays, simulated",
    "tighten": "Holds that tighten at a slip: drops, damage, reaction, false alarms, simulated",
    "speed": "Effect of the actuation speed on every predictor, on the twin",
    "springs": "Figure 10b, springs on the twin",
    "table1": "Table 1 and Figures 5 and 6, on simulated holds",
    "table2": "Table 2 and Figure 8b, silicone sheets on the twin",
    "table3": "Table 3 and Figure 9, exercise balls on the twin",
    "table4": "Table 4 and Figure 11c on the twin",
    "table5": "Table 5: force estimated early, simulated",
    "table6": "Table 6 and Figure 17b: a dropped apple, free or supported, simulated",
    "figure16": "Figure 16: avocados over four days, rigid and soft fingers, simulated",
    "stiffness": "Stiffness in N/mm over two decades, simulated",
    "staircases": "Current force during staircases of closing and opening, simulated",
    "settled": "Settled values of real materials, without and with own holds",
    "meat": "The cut of meat, and spread between specimens, real holds and presses",
    "sorting": "A mixed crate with unknown kinds, identified and sorted, simulated",
}
_BENCHMARK_TEXTS = {
    "all": "All benchmarks in turn",
    "frames": "Decoding frames from memory compared with CSV lines and FlexiTac's package",
    "settling": "Predictors of the settled value compared with curve_fit",
}
#: Study -> (module, description).
STUDIES: dict[str, tuple[str, str]] = {
    name: (f"palpate_studies.{name.replace('-', '_')}", text) for name, text in _STUDY_TEXTS.items()
}
#: Benchmark -> (module, description).
BENCHMARKS: dict[str, tuple[str, str]] = {
    name: (f"palpate_studies.benchmarks.{'running' if name == 'all' else name}", text)
    for name, text in _BENCHMARK_TEXTS.items()
}
