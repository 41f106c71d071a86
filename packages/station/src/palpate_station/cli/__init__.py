"""Verbs of the station: `palpate serve`, `items`, `report`, `ripeness`, `bruise`, `sort`, `qualify`, `teach`."""
