"""Mistakes typed on purpose: each is one line that names what is wrong, before any work, and leaves no file."""

import cv2
import numpy as np
import pytest

from colmap_lazyloc.__main__ import main
from colmap_lazyloc.testing import synthetic


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Makes a folder with what a user may name by mistake."""
    folder = tmp_path_factory.mktemp("mistakes")
    for name in ("photos/a.png", "photos/b.png", "new/c.png"):
        (folder / name).parent.mkdir(exist_ok=True)
        assert cv2.imwrite(str(folder / name), np.zeros((6, 8, 3), np.uint8))
    synthetic.write_model(folder / "model", synthetic.make_scene(synthetic.arc(3), synthetic.arc(1)))
    (folder / "empty").mkdir()
    for name in ("notes.txt", "film.mp4", "broken.jpg"):
        (folder / name).write_text("hello\n")
    (folder / "points.csv").write_text("point,x,y,z\nP,0,0,0\nQ,1,0,0\nR,0,1,0\n")
    marks = (f"{photo},{point},3,3\n" for photo in ("a.png", "b.png", "z.png") for point in "PQ")
    (folder / "marks.csv").write_text("photo,point,x,y\n" + "".join(marks))
    return folder


@pytest.fixture
def typed(place, colmap, monkeypatch, capfd, fingerprint):
    """Returns a function that types a command, and returns what it prints, without the name of the program."""
    monkeypatch.setenv("COLMAP", str(colmap))
    monkeypatch.chdir(place)

    def run(words, exit_code=1):
        before, _ = fingerprint(place)
        assert main(words) == exit_code
        assert fingerprint(place)[0] == before
        printed = capfd.readouterr()
        return printed.err if exit_code else printed.out

    return run


RUN = {"--database_images": "photos", "--queries": "new", "--output": "out", "--poses": "model"}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"--query_camera": "PINHOL 8 6 9 9 4 3"},
            "--query_camera: unknown camera model 'PINHOL'; the nearest is PINHOLE",
        ),
        ({"--query_camera": "PINHOLE 8 6 9"}, "takes 4 parameters, not 1"),
        ({"--camera": "PINHOL 8 6 9 9 4 3"}, "--camera: unknown camera model 'PINHOL'; the nearest is PINHOLE"),
        ({"--queries": "notes.txt"}, "notes.txt: is neither a photo nor a video"),
        ({"--queries": "film.mp4"}, "film.mp4: is neither a photo nor a video"),
        ({"--queries": "broken.jpg"}, "--queries broken.jpg: is not a photo that can be read"),
        ({"--queries": "empty"}, "empty: holds no image file"),
        ({"--queries": "nowhere"}, "--queries nowhere: does not exist"),
        ({"--database_images": "empty"}, "empty: holds no image file"),
        ({"--database_images": "photos/a.png"}, "--database_images photos/a.png: is neither a folder nor a video"),
        ({"--output": "notes.txt"}, "--output notes.txt: notes.txt is not a folder"),
        ({"--output": "notes.txt/out"}, "--output notes.txt/out: "),
        ({"--output": "photos"}, "--output photos: is also --database_images"),
        ({"--poses": "notes.txt"}, "notes.txt: its format is not known"),
        ({"--poses": "empty"}, "empty: holds no COLMAP model"),
        ({"--poses_format": "transform"}, "--poses_format: invalid choice: 'transform'; the nearest is transforms"),
        ({"--geo_origin": "north"}, "--geo_origin: expected LATITUDE,LONGITUDE,HEIGHT"),
        ({"--masks": "empty"}, "--masks empty: has no mask"),
        ({"--panoramas": "query"}, "--panoramas: invalid choice: 'query'; the nearest is queries"),
        ({"--frames_per_second": "0"}, "--frames_per_second: must be positive"),
        ({"--sequence": "0"}, "--sequence: must be a whole number of at least 1"),
        ({"--overwrite": "2"}, "--overwrite: invalid choice: 2"),
        ({"--complete": "yes"}, "--complete: expected a number, found 'yes'"),
        ({"--num_neighbors": "3", "--resume": "1"}, "unknown option --resume (lazyloc run --help)"),
        ({"--unit": "metres"}, "--unit: invalid choice: 'metres'"),
        ({"--ouput": "x"}, "unknown option --ouput; the nearest is --output"),
        ({"--query": "x"}, "unknown option --query; the nearest is --queries"),
        ({"--num_neighbours": "3"}, "unknown option --num_neighbours; the nearest is --num_neighbors"),
        ({"--onnx_path": "nowhere"}, "--onnx_path nowhere: is not a folder"),
        ({"--SiftExtraction.max_num_feature": "9"}, "the nearest is --SiftExtraction.max_num_features"),
        ({"--SiftExtraction.max_num_features": "many"}, "('many') for option '--SiftExtraction.max_num_features'"),
        ({"--SiftExtraction.max_num_features": "-5"}, "--SiftExtraction.max_num_features must be >= -1, but is -5"),
        ({"--LazyLocalizer.num_retreived": "4"}, "the nearest is --LazyLocalizer.num_retrieved"),
        ({"--LazyLocalizer.min_confidence": "7"}, "--LazyLocalizer.min_confidence must be <= 1, but is 7"),
        ({"--epoch": "yes"}, "--epoch: invalid choice: 'yes'; choose from 'new', 'both'"),
        ({"--control_points": "notes.txt"}, "--control_points has no effect with --poses"),
        ({"--use_control_points": "0.02", "--epoch": "new"}, "--use_control_points needs --control_points"),
        ({"--use_control_points": "0.02", "--control_points": "notes.txt"}, "--use_control_points needs --epoch"),
        ({"--use_control_points": "-1"}, "--use_control_points: must be positive, but is '-1'"),
    ],
)
def test_mistakes_of_run(typed, changed, message):
    lines = typed(["run", *(word for option in (RUN | changed).items() for word in option)]).splitlines()
    assert len(lines) == 1 and message in lines[0] and lines[0].startswith("lazyloc run: "), lines


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--sequence 3", "--sequence needs --query_camera"),
        ("--epoch both --sequence 3", "--sequence needs --query_camera"),
        ("--control_points nowhere.txt", "nowhere.txt: does not exist"),
        (
            "--control_points points.csv marks.csv",
            "without --poses, at least 3 points that are not on one line are needed; marked photos: a.png, b.png, ",
        ),
        ("--control_points notes.txt", "notes.txt: has no row with the names of its columns"),
        (
            "--scale a:1,1 b:1,1 2 --control_points notes.txt --use_control_points 0.02 --epoch new",
            "--control_points has no effect with --scale: compare with the points after the run (lazyloc ",
        ),
        ("--scale a.png b.png", "--scale: expected 3 arguments"),
        ("--scale a.png z.png 4.2m", "--scale z.png: is not in --database_images; the nearest is b.png"),
        ("--scale a.png b.png 4.2cm", "--scale: expected a distance in metres, found '4.2cm'"),
        ("--crs EPSG:99999", "--crs EPSG:99999: Invalid projection"),
    ],
)
def test_mistakes_of_run_without_poses(typed, words, message):
    command = f"run --database_images photos --queries new --output out {words}"
    lines = typed(command.split()).splitlines()
    assert len(lines) == 1 and message in lines[0], lines


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("changes", "required: RESULTS"),
        ("changes model", "model: is not the output folder of lazyloc run --epoch or of colmap lazy_epoch"),
        ("completion fish", "unrecognized arguments: fish"),
        ("control_points", "required: RESULTS, FILE"),
        ("control_points model nowhere.txt", "nowhere.txt: does not exist"),
        ("control_points model notes.txt", "notes.txt: has no row with the names of its columns"),
        ("control_points model notes.txt --ouput x", "unknown option --ouput; the nearest is --output"),
        ("export nowhere --format tum --output x.tum", "nowhere/results.jsonl: cannot be read"),
        ("export model --format tumm --output x.tum", "--format: invalid choice: 'tumm'; the nearest is tum"),
        ("export model --format tum", "required: --output"),
        ("export model --format tum --ouput x", "unknown option --ouput; the nearest is --output"),
        ("serve", "required: MODEL"),
        ("serve nowhere", "nowhere: does not exist"),
        ("serve notes.txt", "notes.txt: is not a folder"),
        ("serve model", "database.db: does not exist: name the database with --database_path"),
        ("serve model --prt 1", "unknown option --prt; the nearest is --port"),
        ("serve model --port http", "--port: must be a whole number from 0 to 65535, but is 'http'"),
        ("check notes.txt model", "notes.txt: is not a readable COLMAP database"),
        ("check notes.txt nowhere", "nowhere: holds no COLMAP model"),
        ("cluster --num_shards 3", "required: --output_path"),
        ("evaluate nowhere --ground_truth model", "nowhere: cannot be read"),
        ("import tum notes.txt --output_path m", "notes.txt: has 1 column instead of 8"),
        ("import exif photos --output_path g.txt --model model", "--model model: has no geo.json"),
        ("rum", "unknown command 'rum'; the nearest is run"),
        ("help rum", "unknown command 'rum'; the nearest is run"),
        ("localize photos", "unknown command 'localize' (lazyloc --help)"),
        (
            "run --database_images photos --queries new/c.png photos/a.png --output out",
            "unexpected word photos/a.png: --queries takes one value; to pass several photos, pass their folder",
        ),
        ("run", "required: --database_images, --queries, --output"),
        ("run --database_images photos --queries new --ouput out", "unknown option --ouput; the nearest is --output"),
        ("report nowhere --output r.html", "nowhere/results.jsonl: cannot be read"),
        ("report nowhere --output_path r.html", "nowhere/results.jsonl: cannot be read"),
        ("report nowhere --ouput r.html", "unknown option --ouput; the nearest is --output"),
        (
            "import transform notes.txt --output_path m",
            "FORMAT: invalid choice: 'transform'; the nearest is transforms",
        ),
        ("import auto notes.txt --output_path m", "notes.txt: its format is not known"),
        ("import auto model --output_path notes.txt", "--output_path notes.txt: is not a folder"),
        ("import auto model --output_pth m", "unknown option --output_pth; the nearest is --output_path"),
        ("evaluate model --groundtruth model", "unknown option --groundtruth; the nearest is --ground_truth"),
        ("check nowhere model", "nowhere: does not exist"),
        ("check model", "required: MODEL"),
        ("demo --scene survay --output_path d", "--scene: invalid choice: 'survay'; the nearest is survey"),
        ("demo --num_query_image 3 --ouput_path d", "unknown option --ouput_path; the nearest is --output_path"),
        ("retrieve --descriptor_pth x", "unknown option --descriptor_pth; the nearest is --descriptors_path"),
        ("doctor --all", "unknown option --all"),
    ],
)
def test_mistakes_of_other_commands(typed, command, message):
    lines = typed(command.split()).splitlines()
    assert len(lines) == 1 and message in lines[0], lines


def test_help_of_a_command(typed):
    assert typed(["help", "run"], exit_code=0).startswith("usage: lazyloc run ")
