"""Command lines that are refused: one line of error, no traceback, and no file is written."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from packages.station.tests.cli.test_sort_and_identify import RULES, SIZE_RULES, fill_store
from packages.station.tests.cli.test_teach_command import write_readings
from tests.commands import Command

from palpate_station.records import Item
from palpate_station.store import Store

#: Command lines, and the essential part of the message.
USAGE = [
    ("--nonsense", "`palpate --help`"),
    ("gras", "`palpate --help`"),
    ("demo circus", "grasp, recordings, force"),
    ("calibrate reset", "Did you mean 'rest'"),
    ("bruise nobody", "no item 'nobody'"),
    ("bruise egg-0 --learn", "training requires 10 of each"),
    ("bruise thing --learn", "has no kind"),
    ("bruise egg-0 --bruised-share 1.5", "--bruised-share"),
    ("calibrate cell --rig sim-rigid --known-n 10", "is simulated"),
    ("calibrate cell --rig none.toml --known-n -1", "above 0 newtons"),
    ("calibrate compliance --block-mm 4", "give the thickness in millimetres"),
    ("calibrate compliance --out none.json", "none.json does not exist yet"),
    ("calibrate rest --rig sim-rigid --out none/pad.json", "the folder none does not exist"),
    ("calibrate force --rig sim-rigid --out none/pad.json", "the folder none does not exist"),
    ("calibrate compliance --rig sim-rigid --out none/pad.json", "the folder none does not exist"),
    ("calibrate settling holds.csv --out fit.txt", ".csv or .parquet"),
    ("calibrate settling holds.csv --rig sim-rigid", "simulated rigs have no holds file"),
    ("doctor --rig a.toml --port b", "--port can't be combined with --rig"),
    ("doctor --recording no.mcap", "can't be opened"),
    ("grasp --object brick", "no simulated object 'brick'; available: ecoflex-10"),
    ("grasp --rig nowhere", "no rig 'nowhere'; available: sim-rigid, sim-soft"),
    ("grasp --rig nowhere.toml", "rig file nowhere.toml: no such file"),
    ("grasp --store x.sqlite", "name the item with --item NAME"),
    ("grasp --item ' '", "must be 1 to 200 printable characters"),
    ("grasp --item A --store no/x.sqlite", "the folder no does not exist"),
    ("grasp --object kiwi --kind kiwi", "requires --damage FILE"),
    ("grasp --object kiwi --damage nowhere.json", "damage file nowhere.json: No such file"),
    ("init rig.json", "must end in .toml"),
    ("init rig.toml --layout round", "unknown layout"),
    ("init rig.toml --layout 5x3 --fingers 2", "5 rows cannot be divided equally"),
    ("init rig.toml --layout soft-3x2 --fingers 3", "has 2 fingers, not 3"),
    ("init rig.toml --reference-ohm -5", "above 0 ohm"),
    ("init rig.toml --rate-hz nan", "frame rate nan Hz"),
    ("init rig.toml --taxel-leg middle", "upper or lower"),
    ("init rig.toml --gripper claw", "module:function"),
    ("init rig.toml --gripper servo --gripper-port /dev/x", "not for servo"),
    ("init rig.toml --idle-lines wet", "idle_lines 'wet'"),
    ("items B9", "no item 'B9'; `palpate items` lists them"),
    ("items never --say taste=good", "NAME is one of ripeness, bruise, identity, bin"),
    ("items never --set kind=", "must be NAME=TEXT"),
    ("items --day yesterday", "not a date; use the form 2026-05-01"),
    ("items --export all.ods", "must end in .parquet, .csv, .xlsx"),
    ("items --store none.sqlite", "no such file"),
    ("qualify readings.csv --limit 15 --limit 13", "increasing order"),
    ("qualify readings.csv --limit 14 --cost 1 -1", "costs must not be negative"),
    ("qualify few-readings.csv", "at least 8 are required"),
    ("record old.mcap --rig sim-rigid --duration 0.5", "already exists"),
    ("record new.mcap --rig missing.toml", "missing.toml: no such file"),
    ("record new.mcap --rig sim-rigid --port x", "--port can't be combined with --rig"),
    ("report", "give exactly one of ITEM, --batch NAME or --day DATE"),
    ("report i9", "no item 'i9'"),
    ("report --day 2020-01-01", "no grasps on 2020-01-01"),
    ("report --day May", "--day May: not a date"),
    ("ripeness", "give an item or --batch NAME"),
    ("ripeness nobody", "nobody"),
    ("ripeness egg-0 --stages ripe", "at least two different stages"),
    ("ripeness egg-0 --ripe green", "a stage after the first: conditioned, ripe, overripe"),
    ("ripeness egg-0 --plot fruit.bmp", "a plot ends in .png"),
    ("serve --rig nowhere.toml", "no rig 'nowhere.toml'; available: sim-rigid"),
    ("serve --rig mujoco --rate-hz 15", "--rate-hz is for sim-rigid"),
    ("serve --object moon", "no simulated object 'moon'; available: ecoflex-10"),
    ("serve --host 0.0.0.0", "set --token"),
    ("serve --host [::]", "--host :: allows other machines to move the gripper"),
    ("serve --damage no.json", "damage file no.json: No such file or directory"),
    ("serve --token short", "the token has 5 characters; use at least 8"),
    ("serve --store none/items.sqlite", "the folder none does not exist"),
    ("serve --folder holds.csv/data", "holds.csv is not a writable folder"),
    ("settle holds.csv --method magic", "no method 'magic'; available: recorded, exponential"),
    ("settle holds.csv --cutoff 0", "--cutoff 0"),
    ("settle holds.csv --cutoff 21", "at most the horizon (20 s)"),
    ("settle holds.csv --level 1", "--level 1"),
    ("settle holds.csv --horizon inf", "--horizon inf"),
    ("settle holds.csv --until-half-width 0", "--until-half-width 0"),
    ("settle holds.csv --plot plot.bmp", "a plot ends in"),
    ("settle holds.csv --out rows.txt", ".json, .csv or .parquet"),
    ("settle holds.csv --fit-on nowhere.csv", "nowhere.csv: no such file"),
    ("settle holds.csv --learn-from holds.csv", "errors on training holds are meaningless"),
    ("settle holds.csv --mean", "requires --rest START:END"),
    ("settle holds.csv --interval -1", "--interval -1"),
    ("settle empty.csv --json --out all.json", "empty.csv: the file is empty"),
    ("settle word.csv --json --out all.json", "word.csv line 3: value is 'oops'"),
    ("settle overflow.csv --json --out all.json", "overflow"),
    ("sort", "give the sorting rules with --rules FILE, or an item with --identify ITEM"),
    ("sort --identify nobody", "no item 'nobody'"),
    ("sort --identify never", "item 'never' was never grasped; grasp it first"),
    ("sort --identify K --rig sim-rigid", "can't be combined with --identify"),
    ("sort --rules rules.toml --batch x", "batch 'x' contains no grasped items"),
    ("sort --rules rules.toml --target-force-n 5", "requires --rig"),
    ("sort --rules pears.toml", "line 7: class 'pear' has fewer than 3 labelled items"),
    ("teach grade --table none.csv", "can't be read"),
    ("teach grade --table bare.csv", "no numeric column"),
    ("teach grade --table few.csv", "at least two labels are required"),
    ("teach bruise", "name the kind of the items with --kind"),
    ("teach grade --say B1=I", "no item 'B1'"),
]
#: The same for lines that open a simulated rig first.
SIMULATED = [
    ("grasp --target-force-n 900", "target"),
    ("grasp --target-force-n nan", "target"),
    ("live --duration 0.2 --rig sim-rigid 127.0.0.1:8765", "--foxglove"),
    ("live --duration 0.2 --rig sim-rigid 127.0.0.1:8765 --foxglove --rerun", "one viewer"),
    ("live --duration 0.2 --rig sim-rigid 127.0.0.1:70000 --foxglove", "HOST:PORT"),
    ("live --duration 0.2 --rig sim-rigid nowhere.invalid:8765 --foxglove", "another address"),
    ("record new.mcap --rig sim-rigid", "would never end; give a --duration"),
    ("sort --rules sizes.toml --rig sim-soft", "requires class or size, but fingers driven by"),
]
#: Exit status 3: equipment.
EQUIPMENT = [
    ("calibrate compliance --rig sim-soft", "no load cell"),
    ("doctor --port /dev/no-such-port", "no port /dev/no-such-port"),
    ("record new.mcap --port /dev/ttyACM99", "no port /dev/ttyACM99"),
]
FILES = {
    "rules.toml": RULES,
    "sizes.toml": SIZE_RULES,
    "pears.toml": RULES.replace('class = "kiwi"', 'class = "pear"'),
    "bare.csv": "item_id,label\nA1,soft\n",
    "few.csv": "item_id,label,firmness\nA1,soft,41\n",
    "holds.csv": "hold_id,time_s,value\n" + "".join(f"h,{k / 10},{99 - k}\n" for k in range(210)),
    "empty.csv": "",
    "old.mcap": "",
    "word.csv": "hold_id,time_s,value\na,0,1\na,1,oops\n",
    "overflow.csv": "time_s,percent\n"
    + "".join(f"{k / 20},{(-1) ** k * 1.7e308}\n" for k in range(400)),
}


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files that the command lines name."""
    folder = tmp_path_factory.mktemp("refused")
    for name, content in FILES.items():
        (folder / name).write_text(content)
    write_readings(folder / "readings.csv", items=40)
    write_readings(folder / "few-readings.csv", items=5)
    fill_store(folder / "items.sqlite")
    with Store.open(folder / "items.sqlite") as store:
        store.add_item(Item(item_id="thing"))
    return folder


@pytest.mark.parametrize(
    ("line", "message", "status"),
    [
        *((*row, 2) for row in USAGE),
        *(pytest.param(*row, 2, marks=pytest.mark.slow) for row in SIMULATED),
        *((*row, 3) for row in EQUIPMENT),
    ],
)
def test_line_is_refused_and_writes_no_file(
    line: str,
    message: str,
    status: int,
    filled: Path,
    palpate: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(filled)
    monkeypatch.setenv("PALPATE_STORE", "items.sqlite")
    before = {path: path.read_bytes() for path in filled.iterdir()}
    assert message in palpate.refused(*shlex.split(line), status=status)
    assert {path: path.read_bytes() for path in filled.iterdir()} == before
