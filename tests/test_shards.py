"""Tests that the shards of a run, merged, are the run, byte for byte, and that wrong shards are named."""

import json
import shutil
import subprocess

import pytest

from colmap_lazyloc.testing import synthetic
from test_resume import output_bytes

NUM_SHARDS = [1, 3, 64]


@pytest.fixture(scope="session")
def merge(colmap):
    """Runs `colmap lazy_merger`."""

    def run(input_path, output_path, *more):
        command = [colmap, "lazy_merger", "--input_path", input_path, "--output_path", output_path, *more]
        return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)

    return run


@pytest.fixture(scope="session")
def make_shards(localize):
    """Localizes all shards of a run into folders 1..count."""

    def make(folder, count, *arguments):
        for index in range(1, count + 1):
            run = localize(*arguments, "--shard", f"{index}/{count}", output_path=folder / str(index))
            assert run.exit_code == 0, run.stderr
        return folder

    return make


def assert_merged_is_whole(localize, merge, make_shards, tmp_path, arguments, counts):
    """Checks the union of shards for several numbers of them; returns the whole run."""
    whole = localize(*arguments)
    assert whole.exit_code == 0, whole.stderr
    for count in counts:
        shards = make_shards(tmp_path / f"shards{count}", count, *arguments)
        done = merge(shards, tmp_path / f"merged{count}")
        assert done.returncode == 0, done.stderr
        assert output_bytes(tmp_path / f"merged{count}") == output_bytes(whole.output_path)
        names = []
        for index in range(1, count + 1):
            results = (shards / str(index) / "results.jsonl").read_text().splitlines()
            names += [json.loads(line)["name"] for line in results]
        assert sorted(names) == sorted(whole.results), "each query is in one shard"
    return whole


@pytest.fixture(scope="module")
def scene_files(tmp_path_factory, write_scene_files):
    """Makes queries that are matched with each other too."""
    scene = synthetic.make_scene(
        synthetic.arc(7), synthetic.arc(9, radius=5, height=-0.7), noise_px=0.5, outlier_ratio=0.3, database_pairs=True
    )
    return write_scene_files(tmp_path_factory.mktemp("scene"), scene)


@pytest.mark.parametrize("counts", NUM_SHARDS)
def test_synthetic_scene(localize, merge, make_shards, tmp_path, scene_files, counts):
    """64 shards of nine queries: most are empty."""
    assert_merged_is_whole(localize, merge, make_shards, tmp_path, scene_files.arguments, [counts])


def test_groups(localize, merge, make_shards, tmp_path, scene_files):
    arguments = [*scene_files.arguments, "--LazyLocalizer.group_size", 2]
    assert_merged_is_whole(localize, merge, make_shards, tmp_path, arguments, [3])


def test_trajectory(localize, merge, make_shards, tmp_path, scene_files):
    names = scene_files.scene.query_names
    lines = [f"{name} {scene_files.scene.images[name].pose.text()}\n" for name in names[:7]]
    (tmp_path / "trajectory.txt").write_text("".join(lines))
    arguments = [*scene_files.arguments, "--query_trajectory_path", tmp_path / "trajectory.txt"]
    whole = assert_merged_is_whole(localize, merge, make_shards, tmp_path, arguments, [3])
    assert whole.results[names[0]]["frame"] == names[0]


def test_leave_one_out(localize, merge, make_shards, tmp_path, scene_files):
    arguments = [*scene_files.arguments, "--LazyLocalizer.leave_one_out", 1]
    whole = assert_merged_is_whole(localize, merge, make_shards, tmp_path, arguments, [3])
    assert (whole.output_path / "leave_one_out.json").exists()


def test_rig(localize, merge, make_shards, tmp_path, scene_files):
    """Pairs of queries are frames of a rig, which no shard takes apart."""
    scene = scene_files.scene
    poses = [scene.images[name].pose for name in scene.query_names[:2]]
    config = [{"cameras": [{"image_prefix": "query/000", "ref_sensor": True}, {"image_prefix": "query/001"}]}]
    rotation = poses[1].rotation @ poses[0].rotation.T
    config[0]["cameras"][1]["cam_from_rig_rotation"] = quaternion(rotation)
    config[0]["cameras"][1]["cam_from_rig_translation"] = list(poses[1].tvec - rotation @ poses[0].tvec)
    (tmp_path / "rig.json").write_text(json.dumps(config))
    arguments = [*scene_files.arguments, "--rig_config_path", tmp_path / "rig.json"]
    whole = assert_merged_is_whole(localize, merge, make_shards, tmp_path, arguments, [3])
    frames = {result["frame"] for result in whole.results.values()}
    assert len(frames - {None}) == 1


def quaternion(rotation):
    """Returns w x y z of a matrix."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return [w, x, y, z]


def test_photos(localize, merge, make_shards, tmp_path, photos):
    """Photos get new ids, which must not depend on the shard."""
    queries = photos.write_queries(tmp_path / "queries.txt")
    assert_merged_is_whole(localize, merge, make_shards, tmp_path, photos.arguments(queries), [2])


@pytest.fixture(scope="module")
def four(make_shards, scene_files, tmp_path_factory):
    """Makes the four shards of a run; tests must not change them."""
    return make_shards(tmp_path_factory.mktemp("four"), 4, *scene_files.arguments)


@pytest.fixture
def shards(four, tmp_path):
    return shutil.copytree(four, tmp_path / "shards")


def assert_refused(done, output_path, *words):
    assert done.returncode == 1
    assert done.stderr.startswith("ERROR: ") and done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr
    assert not output_path.exists()


def test_missing_shards_are_named_as_ranges(merge, shards, tmp_path):
    for index in (1, 3, 4):
        shutil.rmtree(shards / str(index))
    assert_refused(merge(shards, tmp_path / "out"), tmp_path / "out", "of 4 shards, missing: 1,3-4")


def test_unfinished_shard_is_named(merge, shards, tmp_path):
    (shards / "2" / "shard").rename(shards / "2" / "unfinished")
    assert_refused(merge(shards, tmp_path / "out"), tmp_path / "out", "of 4 shards, unfinished: 2")


def test_doubled_shard_is_named(merge, shards, tmp_path):
    shutil.copytree(shards / "2", shards / "copy")
    assert_refused(merge(shards, tmp_path / "out"), tmp_path / "out", "copy: is shard 2/4, as ", "/2 is")


def test_shard_of_another_run_is_named(localize, merge, shards, tmp_path, scene_files):
    arguments = [*scene_files.arguments, "--shard", "2/4", "--LazyLocalizer.seed", 7]
    localize(*arguments, output_path=shards / "2")
    words = ["shards/2: is not of the same run as ", "option --LazyLocalizer.seed is '7' and was '0'"]
    assert_refused(merge(shards, tmp_path / "out"), tmp_path / "out", *words)


def test_shard_of_another_number_is_named(localize, merge, shards, tmp_path, scene_files):
    localize(*scene_files.arguments, "--shard", "2/5", output_path=shards / "2")
    assert_refused(merge(shards, tmp_path / "out"), tmp_path / "out", "shards/2: is not of the same run", "shard 2/5")


def test_truncated_shard_is_named(merge, shards, tmp_path):
    records = next(path for path in sorted(shards.glob("*/shard/records.bin")) if path.stat().st_size > 0)
    records.write_bytes(records.read_bytes()[:-1])
    assert_refused(merge(shards, tmp_path / "out"), tmp_path / "out", f"{records}: is damaged from byte ")
    records.write_bytes(b"")
    assert_refused(merge(shards, tmp_path / "out"), tmp_path / "out", f"{records}: is truncated: it has 0 of ")
    records.unlink()
    assert_refused(merge(shards, tmp_path / "out"), tmp_path / "out", f"{records}: cannot be opened")


def test_changed_database_is_refused(merge, shards, tmp_path, scene_files):
    database = tmp_path / "database.db"
    shutil.copy(scene_files.database_path, database)
    assert merge(shards, tmp_path / "copy", "--database_path", database).returncode == 0
    with open(database, "r+b") as file:
        file.seek(-1, 2)
        last = file.read(1)[0]
        file.seek(-1, 2)
        file.write(bytes([last ^ 1]))
    done = merge(shards, tmp_path / "out", "--database_path", database)
    assert_refused(done, tmp_path / "out", f"{database} (--database_path of the shards) has changed")


def test_list_of_folders(merge, shards, tmp_path):
    """Shards of several machines need not be in one folder."""
    (shards / "1").rename(tmp_path / "elsewhere")
    folders = [tmp_path / "elsewhere", *(shards / str(index) for index in (4, 2, 3))]
    (tmp_path / "list.txt").write_text("".join(f"{folder}\n" for folder in folders))
    assert merge(tmp_path / "list.txt", tmp_path / "out").returncode == 0
    (tmp_path / "list.txt").write_text(f"{tmp_path / 'none'}\n")
    assert_refused(
        merge(tmp_path / "list.txt", tmp_path / "out2"), tmp_path / "out2", "list.txt:1: ", "is not a folder"
    )


def test_finished_shard_is_not_localized_again(localize, shards, scene_files):
    before = output_bytes(shards / "3")
    run = localize(*scene_files.arguments, "--shard", "3/4", "--resume", 1, output_path=shards / "3")
    assert run.exit_code == 0 and "shard 3/4 is finished" in run.stderr
    assert output_bytes(shards / "3") == before


def test_shard_must_be_a_part(localize, scene_files):
    for text in ("0/4", "5/4", "1", "a/b"):
        run = localize(*scene_files.arguments, "--shard", text)
        assert (
            run.exit_code == 1
            and f"option --shard must be two numbers like 17/256, the first from 1 to the second, but is '{text}'"
            in run.stderr
        )


def test_help_of_the_merger(colmap):
    done = subprocess.run([colmap, "lazy_merger", "-h"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and "--input_path" in done.stdout and "--database_path" in done.stdout
