"""The report of a short recording, through the command line."""

import json
import re
import shutil

import cv2
import numpy as np
import pytest
from folders import BASELINE_M, DISPARITY_PX, HEIGHT, WIDTH, wall, write_euroc
from terminal import driftyard

STEP_PX = 24


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    pairs = wall(8, STEP_PX)
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    pairs[5] = (blank, blank)
    write_euroc(folder / "wall", pairs, truth_step_m=STEP_PX / DISPARITY_PX * BASELINE_M)
    for name in ("a.txt", "b.txt"):
        words = ("run", "wall", "--out", name, "--estimator", "corner_flow")
        result = driftyard(*words, cwd=folder)
        assert result.returncode == 0, result.stderr
    return folder


def test_run_prints_a_summary(results):
    words = ("run", "wall", "--out", "c.txt", "--estimator", "corner_flow")
    assert driftyard(*words, cwd=results).stdout.startswith("c.txt: 8 frames, 1 lost, ")


def test_score_as_json_has_all_figures(results):
    result = driftyard("score", "wall", "a.txt", "--json", cwd=results)
    (score,) = json.loads(result.stdout)
    assert (score["file"], score["frames"]) == ("a.txt", 8)
    assert score["statuses"] == {"start": 2, "tracked": 5, "weak": 0, "lost": 1}
    # 7 steps of 0.3 m; the resumed start has missed two of them.
    assert score["path_m"] == pytest.approx(2.1)
    assert score["end_m"] == pytest.approx(0.6, abs=0.02)
    assert 0 < score["ate_m"]["se3"]["rmse"] < score["ate_m"]["first_pose"]["rmse"]


def test_score_as_table_has_a_column_per_run(results):
    result = driftyard("score", "wall", "a.txt", "b.txt", cwd=results)
    assert result.stdout.count("corner_flow") == 2
    assert "drift over 1 m" in result.stdout


def test_report_is_one_page_with_every_section(results):
    result = driftyard("report", "wall", "a.txt", "b.txt", "--out", "page.html", cwd=results)
    assert result.returncode == 0, result.stderr
    page = (results / "page.html").read_text(encoding="utf-8")
    for words in (
        "drift over 1 m",
        "Scores",
        "The path from above",
        "Observations of corner_flow (a)",
        "Error over distance",
        "Items after each stage",
        "Time per stage",
        "Definitions of the metrics",
        "Settings and versions: corner_flow (b)",
    ):
        assert words in page, words
    assert 'id="lost-from-5"' in page
    assert page.count("data:image/jpeg;base64,") >= 3
    outside = re.findall(r'(?:src|href)="(?!data:|#)([^"]*)"', page)
    assert outside == []
    assert "nan" not in "".join(re.findall(r' d="([^"]*)"', page)).lower()


def test_report_map_is_placed_as_the_manifest_states(results):
    cv2.imwrite(str(results / "wall" / "map.png"), np.zeros((50, 100, 3), np.uint8))
    place = {"file": "map.png", "x_min_m": -1.0, "y_max_m": 2.0, "metres_per_px": 0.05}
    manifest = results / "wall" / "dataset.json"
    manifest.write_text(json.dumps({"schema_version": 1, "map": place}))
    driftyard("report", "wall", "a.txt", "--out", "map.html", cwd=results)
    page = (results / "map.html").read_text(encoding="utf-8")
    manifest.unlink()
    (svg,) = re.findall(r'<svg style="background: url\(data:image/jpeg.*?</svg>', page, re.DOTALL)
    width = float(re.search(r'viewBox="0 0 ([\d.]+)', svg)[1])
    start = re.search(r'<g id="start">.*?<use [^>]*x="([\d.]+)" y="([\d.]+)"', svg, re.DOTALL)
    # The map is 5 m wide: the start, at the world's origin, is 1 m from its left, 2 m from its top.
    assert [float(x) / width for x in start.groups()] == pytest.approx([1 / 5, 2 / 5], abs=1e-3)


def test_report_of_selected_frames_shows_their_images(results):
    words = ("--estimator", "corner_flow", "--every", "2")
    assert driftyard("run", "wall", "--out", "e.txt", *words, cwd=results).returncode == 0
    result = driftyard("report", "wall", "e.txt", "--out", "e.html", cwd=results)
    assert result.returncode == 0, result.stderr
    captions = dict(re.findall(r"frame (\d), (\d\.\d) s:", (results / "e.html").read_text()))
    assert captions
    assert all(float(time) == pytest.approx(0.2 * int(frame)) for frame, time in captions.items())


def test_report_with_true_positions_has_ate_and_dashes(results):
    shutil.copytree(results / "wall" / "mav0", results / "prism" / "mav0")
    (results / "prism" / "mav0" / "state_groundtruth_estimate0").rename(results / "truth")
    (results / "prism" / "mav0" / "leica0").mkdir()
    rows = [f"{(i + 1) * 10**8},{0.3 * i},{i % 2},0\n" for i in range(8)]
    (results / "prism" / "mav0" / "leica0" / "data.csv").write_text("".join(rows))
    result = driftyard("report", "prism", "a.txt", "--out", "p.html", cwd=results)
    assert result.returncode == 0, result.stderr
    assert "has positions only" in result.stderr
    page = (results / "p.html").read_text(encoding="utf-8")
    assert "ATE, SE(3): the truth has positions only, without attitude" in page
    assert re.search(r"<b>–</b><span[^>]*>drift over 1 m", page)
    assert "true position, all positions aligned." in page
    assert "nan" not in "".join(re.findall(r' d="([^"]*)"', page)).lower()
