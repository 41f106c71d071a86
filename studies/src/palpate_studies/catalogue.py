"""The table of studies and benchmarks, found by `palpate study` and `palpate bench`."""

from __future__ import annotations

#: Study -> (module, what it shows). Each module holds a function `command`.
STUDIES: dict[str, tuple[str, str]] = {
    "challenge": (
        "palpate_studies.challenge",
        "Your own method, ours and every rival on three kinds of real recordings",
    ),
    "force-ladders": (
        "palpate_studies.force_ladders",
        "Dead weights on real Velostat, sensors held out",
    ),
    "import-data": (
        "palpate_studies.import_data",
        "Tables of real recordings from clones of the public repositories",
    ),
    "force-population": (
        "palpate_studies.force_population",
        "What real sensors have in common: the constants of the force law",
    ),
    "force-control": (
        "palpate_studies.force_control",
        "Random things gripped to a force and lifted, simulated",
    ),
    "grasp-cycle": (
        "palpate_studies.grasp_cycle",
        "Seconds to touch and answer, what they risk and what is learned, simulated",
    ),
    "faults": ("palpate_studies.faults", "Single faults in every phase of a grasp, simulated"),
    "harvest": (
        "palpate_studies.harvest",
        "Pulls of 1 to 10 N on held fruit: the verdict against the truth, simulated",
    ),
    "noise": (
        "palpate_studies.noise",
        "Filters against mains pick-up and motor spikes, on the twin",
    ),
    "qualify": (
        "palpate_studies.qualify",
        "Agreement with a penetrometer: 720 real apples, and simulated ones on the twin",
    ),
    "presses": ("palpate_studies.presses", "Force now on real Velostat under a robot's presses"),
    "histories": (
        "palpate_studies.histories",
        "Force of stretched silicone from the history of its resistance, real recordings",
    ),
    "hydrogel": (
        "palpate_studies.hydrogel",
        "Force of a real hydrogel sensor in a robot's force loop, recordings left out",
    ),
    "strokes": (
        "palpate_studies.strokes",
        "Force of real Velostat touched by pins, sensors and pins left out",
    ),
    "ripeness": (
        "palpate_studies.ripeness",
        "Figure 16, stages and days to ripe of avocados on the twin",
    ),
    "rupture": (
        "palpate_studies.rupture",
        "When to stop closing on real fruit, before it ruptures",
    ),
    "rupture-limits": (
        "palpate_studies.rupture_limits",
        "How much of a rupture the curve before it can show",
    ),
    "realism": ("palpate_studies.realism", "The twin's scatter compared with real recordings"),
    "bruise": (
        "palpate_studies.bruise",
        "Table 6 and Figure 17, bruised and sound apples, simulated",
    ),
    "detection-limit": (
        "palpate_studies.detection_limit",
        "Weakest force seen and linearity, on the twin",
    ),
    "environment": (
        "palpate_studies.environment",
        "Figures 1b and 3, climate and suction on the twin",
    ),
    "fatigue": (
        "palpate_studies.fatigue",
        "Figure 4, 2 500 cycles on the twin, re-zeroed and corrected",
    ),
    "second-generators": (
        "palpate_studies.second_generators",
        "Ripening and bruises of a shape that no rule was made on, simulated",
    ),
    "speed": ("palpate_studies.speed", "Actuation speed against every predictor, on the twin"),
    "size": ("palpate_studies.size", "Figure 14, size of strawberries in 1 mm steps, simulated"),
    "slip": ("palpate_studies.slip", "Slip and removal: rates, false alarms, delays, simulated"),
    "springs": ("palpate_studies.springs", "Figure 10b, springs on the twin"),
    "table1": ("palpate_studies.table1", "Table 1 and Figures 5 and 6, on simulated holds"),
    "table2": ("palpate_studies.table2", "Table 2 and Figure 8b, silicone sheets on the twin"),
    "table3": ("palpate_studies.table3", "Table 3 and Figure 9, exercise balls on the twin"),
    "table4": (
        "palpate_studies.table4",
        "Table 4 and Figure 11c on the twin, and why slopes differ",
    ),
    "table4-preload": (
        "palpate_studies.table4_preload",
        "Table 4 with rest values taken under a preload, on the twin",
    ),
    "table5": ("palpate_studies.table5", "Table 5: force estimated early, simulated"),
    "table6": (
        "palpate_studies.table6",
        "Table 6: a dropped apple, free between the fingers or supported, simulated",
    ),
    "figure16": (
        "palpate_studies.figure16",
        "Figure 16: avocados over four days, rigid fingers and four kinds of soft ones, simulated",
    ),
    "stiffness": ("palpate_studies.stiffness", "Stiffness in N/mm over two decades, simulated"),
    "staircases": (
        "palpate_studies.staircases",
        "Force now during staircases of closing and opening, simulated",
    ),
    "settled": (
        "palpate_studies.settled",
        "Settled values on real materials that no rule learned from, and after own holds",
    ),
    "identify": (
        "palpate_studies.identify",
        "What each item of a mixed crate is, strangers among them, simulated",
    ),
    "sorting": (
        "palpate_studies.sorting",
        "Purity and items per hour of sorting by rules, simulated",
    ),
}

#: Benchmark -> (module, what it compares), of the same form.
BENCHMARKS: dict[str, tuple[str, str]] = {
    "all": ("palpate_studies.benchmarks.everything", "All of these, one after the other"),
    "crosstalk": (
        "palpate_studies.benchmarks.crosstalk",
        "Pixels solved out of a matrix's crosstalk against SciPy's dense solve and root",
    ),
    "files": (
        "palpate_studies.benchmarks.files",
        "Recordings and CSV tables, written and read, against csv and pandas",
    ),
    "frames": (
        "palpate_studies.benchmarks.frames",
        "Frames decoded from memory against lines of CSV and FlexiTac's package",
    ),
    "growth": (
        "palpate_studies.benchmarks.growth",
        "Batches of a thousand holds and more against a matrix product and memory bandwidth",
    ),
    "port": (
        "palpate_studies.benchmarks.port",
        "A board read live against pyserial's readline of CSV lines",
    ),
    "settling": (
        "palpate_studies.benchmarks.settling",
        "Predictors of the settled value against curve_fit and lmfit",
    ),
}
