"""The cost named on the hardware page is the sum of its bill of materials."""

from __future__ import annotations

from tests.pages import ROOT


def test_cost_is_the_sum_of_the_parts_without_gripper_and_load_cells() -> None:
    page = (ROOT / "hardware" / "README.md").read_text(encoding="utf-8")
    rows = page.split("| part | quantity |")[1].split("\n\n")[0].splitlines()[2:]
    low_usd = high_usd = 0.0
    for row in rows:
        part, quantity, _, price = (cell.strip() for cell in row.strip("| ").split("|"))
        if part.startswith("*for"):
            continue
        pieces = int(quantity[:1] or 1)
        low, _, high = price.partition(" to ")
        low_usd += pieces * float(low)
        high_usd += pieces * float(high or low)
    assert f"cost {low_usd:.0f} to {high_usd:.0f} USD" in page
