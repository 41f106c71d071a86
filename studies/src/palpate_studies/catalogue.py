"""The table of studies and benchmarks, found by `palpate study` and `palpate bench`."""

from __future__ import annotations

#: Study -> what it shows. Its module has its name and holds a function `command`.
_SHOWN = {
    "force-ladders": "Dead weights on real Velostat, sensors held out",
    "import-data": "Tables of real recordings from clones of the public repositories",
    "force-population": "What real sensors have in common: the constants of the force law",
    "force-control": "Random objects gripped to a force and lifted, simulated",
    "grasp-cycle": "Seconds to touch and answer, what they risk and what is learned, simulated",
    "faults": "Single faults in every phase of a grasp, simulated",
    "harvest": "Pulls of 1 to 10 N on held fruit: the verdict against the truth, simulated",
    "noise": "Filters against mains pick-up and motor spikes, on the twin",
    "qualify": "Agreement with a penetrometer: 720 real apples, and simulated ones on the twin",
    "presses": "Force now on real Velostat under a robot's presses",
    "soft-sensor": "Force of a microfluidic soft sensor, depths left out, real recordings",
    "hydrogel": "Force of a real hydrogel sensor in a robot's force loop, recordings left out",
    "strokes": "Force of real Velostat touched by pins, sensors left out",
    "ripeness": "Stages and days to ripe of avocados on the twin",
    "rupture": "When to stop closing on real fruit, before it ruptures",
    "realism": "The twin's scatter compared with real recordings",
    "bruise": "Bruised and sound apples, and Figure 17, simulated",
    "detection-limit": "Weakest force seen and linearity, on the twin",
    "environment": "Figures 1b and 3, climate and suction on the twin",
    "fatigue": "Figure 4, 2 500 cycles on the twin",
    "size": "Figure 14, size of strawberries in 1 mm steps, simulated",
    "slip": "Slip and removal: rates, false alarms, delays, simulated",
    "speed": "Actuation speed against every predictor, on the twin",
    "springs": "Figure 10b, springs on the twin",
    "table1": "Table 1 and Figures 5 and 6, on simulated holds",
    "table2": "Table 2 and Figure 8b, silicone sheets on the twin",
    "table3": "Table 3 and Figure 9, exercise balls on the twin",
    "table4": "Table 4 and Figure 11c on the twin",
    "table5": "Table 5: force estimated early, simulated",
    "table6": "Table 6: a dropped apple, free between the fingers or supported, simulated",
    "figure16": "Figure 16: avocados over four days, rigid and soft fingers, simulated",
    "stiffness": "Stiffness in N/mm over two decades, simulated",
    "staircases": "Force now during staircases of closing and opening, simulated",
    "settled": "Settled values on real materials, and after own holds",
    "meat": "How far specimens of a steak differ, real double presses",
    "sorting": "Items of a mixed crate named and sorted, strangers among them, simulated",
}
_COMPARED = {
    "all": "All of these, one after the other",
    "frames": "Frames decoded from memory against lines of CSV and FlexiTac's package",
    "settling": "Predictors of the settled value against curve_fit",
}
#: Study -> (module, what it shows).
STUDIES: dict[str, tuple[str, str]] = {
    name: (f"palpate_studies.{name.replace('-', '_')}", shown) for name, shown in _SHOWN.items()
}
#: Benchmark -> (module, what it compares).
BENCHMARKS: dict[str, tuple[str, str]] = {
    name: (f"palpate_studies.benchmarks.{'running' if name == 'all' else name}", compared)
    for name, compared in _COMPARED.items()
}
