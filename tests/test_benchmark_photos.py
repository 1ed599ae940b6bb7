"""Tests of the photo benchmarks on a small scene: photos are localized as accurately as images of the database."""

import pytest

from benchmarks import __main__ as benchmarks
from benchmarks.photos import orientations, photometric_stress
from conftest import DATA_PATH


def run(command, photos, colmap, work_path, capsys, *options):
    arguments = [command, photos.folder, "--colmap", colmap, "--work_path", work_path, *options]
    assert benchmarks.main(list(map(str, arguments))) == 0
    output = capsys.readouterr().out
    lines = [line for line in output.splitlines() if line.startswith("|")]
    return output, [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines]


@pytest.fixture(scope="module")
def work_path(tmp_path_factory):
    return tmp_path_factory.mktemp("work")


def test_photos_are_as_accurate_as_images_of_the_database(photos, colmap, work_path, capsys):
    output, rows = run("photos", photos, colmap, work_path, capsys, "--num_seeds", 1)
    assert "SHA-256" in output
    (accuracy,) = [row for row in rows if row[1] == "2, 4"]  # queries, database images
    position_ratio, rotation_ratio = map(float, accuracy[4].split(" / "))
    assert 0.2 < position_ratio < 5 and 0.2 < rotation_ratio < 5
    assert accuracy[-1] == "0, 0"


def test_index_finds_the_images_and_follows_the_database(photos, colmap, work_path, capsys):
    _, rows = run("retrieval", photos, colmap, work_path, capsys, "--num_retrieved", 4, "--sizes", "5x50", "9x50")
    (recall,) = [row for row in rows if row[0] == "4"]
    assert recall[1:] == ["100.0 %"] * 4  # the database has four images
    assert [len(row) for row in rows if row[0] in ("5 x 50", "9 x 50")] == [6, 6]


@pytest.mark.skipif(not (DATA_PATH.parent / "models").is_dir(), reason=f"{DATA_PATH.parent}/models is missing")
def test_aliked_features_see_through_haze(photos, colmap, tmp_path, capsys, monkeypatch):
    pytest.importorskip("onnxruntime")
    monkeypatch.setattr(photometric_stress, "STRENGTHS", {"haze": (40,)})
    options = ["--onnx_path", DATA_PATH.parent / "models"]
    _, rows = run("photometric_stress", photos, colmap, tmp_path, capsys, *options)
    shares = {row[0]: row[1:] for row in rows if "%" in row[-1]}
    assert shares["as taken"] == ["2", *["100 % [34, 100], 0"] * 4]
    assert shares["haze, 40"][:2] == ["2", "0 % [0, 66], 0"]
    assert shares["haze, 40"][3:] == ["100 % [34, 100], 0"] * 2
    (errors,) = [row[1:] for row in rows if row[0] == "all"]
    assert all(error.endswith(", 2") for error in errors)
    assert errors[-1] == "1.00 [1.00, 1.00], 2", "what SIFT localizes is left alone by AUTO"


@pytest.mark.parametrize("is_given", [True, False])
def test_photos_in_all_orientations(photos, colmap, work_path, capsys, is_given, monkeypatch):
    monkeypatch.setattr(orientations, "INTRINSICS", {is_given: orientations.INTRINSICS[is_given]})
    _, rows = run("orientations", photos, colmap, work_path / "orientations", capsys)
    of = {row[1]: row for row in rows if row[1].isdigit()}
    for orientation in "1368":
        row = of[orientation]
        assert row[2] == "4 of 4"  # of two images, a landscape and a portrait photo
        assert float(row[7].split(", ")[1]) < 50, "the errors are those of the photos as displayed"
        assert (float(row[3].split(", ")[1]) == 0) == (orientation == "1")
    for orientation in "2457":
        assert of[orientation][2:4] == ["0 of 4", "UNREADABLE_IMAGE"]


def test_unknown_benchmark_lists_those_that_there_are(capsys):
    assert benchmarks.main(["magic"]) == 1
    assert "uncertainty" in capsys.readouterr().err
