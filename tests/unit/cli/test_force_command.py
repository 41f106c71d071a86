"""`palpate force`, as typed on files of a logger."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from tests.commands import Command

from palpate.cli.options import parse_ohm
from palpate.demo.force import write_force
from palpate.errors import InputError


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_force(tmp_path)
    return tmp_path


def test_force_of_weights_is_printed_with_what_was_taken_as_what(
    palpate: Command, folder: Path
) -> None:
    printed = palpate("force", "weights.csv", "--adc-bits", 10).out
    for text in ("counts of 10 bits", "rise with the load", "weight_g", "at 0 N", "power law"):
        assert text in printed


def test_force_with_a_load_column_is_saved_and_used_for_another_recording(
    palpate: Command, folder: Path
) -> None:
    circuit = ("--adc-bits", 10, "--reference-ohm", "10k", "--sensor-leg", "upper")
    palpate("force", "presses.csv", *circuit, "--save", "pad.json")
    document = palpate("force", "new.csv", "--calibration", "pad.json", "--json").document
    (contact,) = document["sensors"][0]["contacts"]
    assert contact["low_n"] < 5.0 < contact["high_n"]
    assert contact["peak_n"] == pytest.approx(5.0, rel=0.2)


def test_force_of_a_log_with_weights_in_order_writes_a_table_and_a_plot(
    palpate: Command, folder: Path
) -> None:
    palpate(
        *("force", "log.csv", "--weights", "laid.csv", "--adc-bits", 10),
        *("--output", "newtons.csv", "--plot", "newtons.png"),
    )
    document = palpate("force", "log.csv", "--weights", "laid.csv", "--adc-bits", 10, "--json")
    (sensor,) = document.document["sensors"]
    assert None not in [contact["load_n"] for contact in sensor["contacts"]]
    with (folder / "newtons.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    known = [row for row in rows if row["load_n"]]
    assert {round(float(row["load_n"]), 2) for row in known} == {0.98, 1.96, 4.9, 7.85, 9.81}
    inside = [float(r["low_n"]) <= float(r["load_n"]) <= float(r["high_n"]) for r in known]
    assert np.mean(inside) > 0.9
    assert (folder / "newtons.png").stat().st_size > 1000


def test_force_of_a_load_cell_in_its_own_file(palpate: Command, folder: Path) -> None:
    lines = (folder / "presses.csv").read_text().splitlines()[2:]
    cells = [line.split(",") for line in lines]
    (folder / "pad.csv").write_text("ms,A0\n" + "".join(f"{c[0]},{c[1]}\n" for c in cells))
    grams = [f"{float(c[0]) / 1e3:.3f};{float(c[2]) / 9.80665e-3:.1f}\n" for c in cells[1::2]]
    (folder / "cell.csv").write_text("t [s];Load [g]\n" + "".join(grams))
    split = palpate("force", "pad.csv", "--load-cell", "cell.csv", "--adc-bits", 10, "--json")
    whole = palpate("force", "presses.csv", "--adc-bits", 10, "--json")
    found, expected = (one.document["sensors"][0]["contacts"] for one in (split, whole))
    peaks = [[contact["peak_n"] for contact in one] for one in (found, expected)]
    np.testing.assert_allclose(peaks[0], peaks[1], rtol=0.1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("presses.csv", "--adc-bits", 8), "correct --adc-bits"),
        (("presses.csv", "--adc-bits", 10, "--save", "pad.json"), "--save pad.json: .*ohms"),
        (
            (
                *("presses.csv", "--adc-bits", 10, "--reference-ohm", "10k"),
                *("--sensor-leg", "upper", "--save", "presses.csv"),
            ),
            "lost",
        ),
        (("presses.csv", "--adc-bits", 10, "--output", "presses.csv"), "presses.csv"),
    ],
)
def test_unusable_input_is_refused_in_one_line_and_nothing_is_written(
    palpate: Command, folder: Path, words: tuple[object, ...], message: str
) -> None:
    before = sorted(folder.iterdir())
    printed = palpate("force", *words, status=2)
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert re.search(message, line), line
    assert sorted(folder.iterdir()) == before


def test_json_of_several_sensors(palpate: Command, folder: Path) -> None:
    rows = []
    for pad, gain in (("left", 3), ("right", 9)):
        rows += [f"{pad},{load},{9000 / (1 + gain * load)}\n" for load in (0, 1, 2, 4, 8)]
    (folder / "pads.csv").write_text("pad,load_n,R_ohm\n" + "".join(rows))
    document = palpate("force", "pads.csv", "--json").document
    assert [one["sensor"] for one in document["sensors"]] == ["pads.csv left", "pads.csv right"]
    assert json.dumps(document)
    palpate("force", "pads.csv", "--save", "pad.json", status=2)


@pytest.mark.parametrize("text", ["", "k", "1k2k", "4.7k7", "ten", "10 mF"])
def test_text_that_is_no_resistance_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="resistance"):
        parse_ohm(text)


#: Six weights of one FSR: newtons, and counts of 12 bits.
WEIGHED = ((0.2407, 454), (0.49, 600), (0.73, 720), (0.98, 810), (1.23, 880), (1.72, 990))


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("load_n,A0", "{load},{counts}"),
        # A log of one row for each weight, as people write it down.
        ("Datum;Last [N];A0", "14.03.2026 10:{minute:02}:00;{load};{counts}"),
        ("time_s,load_n,A0", "{seconds},{load},{counts}"),
        # Dates alone are no clock, on one day or several.
        ("date,load_n,A0", "2026-03-14,{load},{counts}"),
        ("date,load_n,A0", "2026-03-{day},{load},{counts}"),
        # The scatter of each reading beside it is not another sensor.
        ("load_n,A0,A0_std", "{load},{counts},{scatter}"),
        ("load_n,R_ohm,spread_ohm", "{load},{ohm},{scatter}"),
    ],
)
def test_rows_far_apart_are_settled_readings_of_one_sensor(
    palpate: Command, tmp_path: Path, head: str, row: str
) -> None:
    lines = [
        row.format(
            load=load, counts=counts, minute=10 + number, seconds=40 * number, day=14 + number // 2,
            scatter=3 + number, ohm=round(1e6 / counts),
        )
        for number, (load, counts) in enumerate(WEIGHED)
    ]  # fmt: skip
    (tmp_path / "weights.csv").write_text("\n".join([head, *lines]) + "\n")
    bits = () if "ohm" in head else ("--adc-bits", "12")
    (sensor,) = palpate("force", tmp_path / "weights.csv", *bits, "--json").document["sensors"]
    known = [one["load_n"] for one in sensor["settled"]]
    assert known == pytest.approx([load for load, _ in WEIGHED])
    assert sensor["held_out"]["what"] == "each weight in turn"


def test_missing_readings_do_not_end_a_contact(palpate: Command, tmp_path: Path) -> None:
    time_s = [0.05 * row for row in range(800)]
    lines = ["t,load,ohm"]
    for row, at_s in enumerate(time_s):
        load = 2.0 + at_s // 10 if 4 < at_s % 10 < 8 else 0.0
        reading = "" if row % 23 == 7 else f"{2e4 / (1 + 5 * load):.1f}"
        lines.append(f"{at_s:.2f},{load},{reading}")
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    command = ("force", tmp_path / "log.csv", "--load-unit", "N", "--json")
    (sensor,) = palpate(*command).document["sensors"]
    assert [one["load_n"] for one in sensor["contacts"]] == [2.0, 3.0, 4.0, 5.0]
