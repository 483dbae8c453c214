"""The command route: what it writes, and how it refuses."""

import csv
import json

import pytest
from terminal import driftyard

NODES = [
    {"name": "a", "x_m": 0, "y_m": 0},
    {"name": "b", "x_m": 3000, "y_m": 1000},
    {"name": "c", "x_m": 3000, "y_m": -1200},
    {"name": "d", "x_m": 6000, "y_m": 0},
]
ROADS = [{"ends": ends} for ends in (["a", "b"], ["a", "c"], ["b", "c"], ["b", "d"], ["c", "d"])]
GOOD = {"nodes": NODES, "roads": ROADS, "start": "a", "goal": "d", "top_speed_kmh": 90}


def route(tmp_path, content, *words):
    text = content if isinstance(content, str) else json.dumps(content)
    (tmp_path / "town.json").write_text(text)
    return driftyard("route", "--map", "town.json", "--out", "o", *words, cwd=tmp_path)


def test_route_of_a_map_writes_figures_data_and_verdicts(tmp_path):
    result = route(tmp_path, GOOD, "--drives", "6", "--share", "0.5")
    assert result.returncode == 0, result.stderr
    assert "all are equal without congestion: holds" in result.stdout
    names = {path.name for path in (tmp_path / "o").iterdir()}
    stems = {"routing_networks.png", "routing_delays.png", "routing_random.png"}
    assert names == stems | {"routing_delays.csv", "routing_random.csv", "routing.json"}
    summary = json.loads((tmp_path / "o/routing.json").read_text())
    assert len(summary["verdicts"]) == 4
    rows = [*csv.DictReader((tmp_path / "o/routing_random.csv").read_text().splitlines())]
    assert len(rows) == 6
    # a to d by way of b, at 90 km/h
    assert [float(row["undelayed_s"]) for row in rows] == pytest.approx([252.98] * 6, abs=0.01)
    again = route(tmp_path, GOOD, "--drives", "6", "--share", "0.5")
    assert again.stdout == result.stdout


@pytest.mark.parametrize(
    ("content", "fragments"),
    [
        ("{", ["not valid JSON"]),
        ("[1]", ["an object"]),
        ({}, ["nodes"]),
        ({**GOOD, "speed": 3}, ["unknown setting speed", "top_speed_kmh"]),
        ({**GOOD, "goal": "z"}, ["no node named z", "a, b, c, d"]),
        ({**GOOD, "goal": "a"}, ["start and goal are both a"]),
        ({**GOOD, "nodes": [*NODES, NODES[0]]}, ["two nodes named a"]),
        ({**GOOD, "roads": [*ROADS, {"ends": ["b", "a"]}]}, ["road b to a", "twice"]),
        ({**GOOD, "roads": [{"ends": ["a", "b"], "length_m": 10}]}, ["road a to b", "3162.3"]),
        ({**GOOD, "roads": [{"ends": ["a", "a"]}]}, ["same place"]),
        ({**GOOD, "roads": [{"ends": ["a", "b"]}]}, ["no path from a to d"]),
        ({**GOOD, "top_speed_kmh": float("nan")}, ["top_speed_kmh"]),
        ({**GOOD, "roads": [{"ends": ["a"]}]}, ["roads.0.ends"]),
    ],
)
def test_route_refuses_a_wrong_map_in_one_line(tmp_path, content, fragments):
    result = route(tmp_path, content)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith("driftyard: error: ")
    assert "town.json: " in line
    for fragment in fragments:
        assert fragment in line
    assert not (tmp_path / "o").exists()


def test_route_refuses_a_missing_map_and_a_file_as_folder(tmp_path):
    result = driftyard("route", "--map", "none.json", "--out", "o", cwd=tmp_path)
    assert (result.returncode, "none.json: cannot be read" in result.stderr) == (2, True)
    (tmp_path / "o").write_text("")
    result = driftyard("route", "--out", "o", cwd=tmp_path)
    assert (result.returncode, "o: is a file" in result.stderr) == (2, True)
