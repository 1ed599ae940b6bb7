"""Pairs from global descriptors: equal to brute force, in any blocks and shards; bad files are named."""

import pathlib
import re

import faiss
import h5py
import numpy as np
import pytest

from colmap_lazyloc.pairs import read_pairs
from colmap_lazyloc.retrieval import __main__ as retrieval
from colmap_lazyloc.retrieval import descriptors, exact, plan
from colmap_lazyloc.shards import Shard
from colmap_lazyloc.testing import synthetic
from conftest import write_lines

NUM_RETRIEVED = 5
DIMENSION = 16


class Files:
    """Descriptors of queries and database images in one of the formats, and what they should give."""

    def __init__(self, folder: pathlib.Path, suffix: str, num_queries=60, num_images=300, dtype=np.float32):
        rng = np.random.default_rng(0)
        self.folder = folder
        self.images = {f"db/{i}.jpg": rng.normal(size=DIMENSION).astype(dtype) for i in range(num_images)}
        self.queries = {f"q/{i}.jpg": rng.normal(size=DIMENSION).astype(dtype) for i in range(num_queries)}
        # Two equal images decide that ties are broken by names; a query that equals them finds both first.
        self.images["db/10.jpg"] = self.images["db/9.jpg"] = self.queries["q/3.jpg"]
        self.query_path = self.write("queries", suffix, self.queries)
        self.image_path = self.write("images", suffix, self.images)

    def write(self, stem, suffix, rows):
        path = self.folder / f"{stem}{suffix}"
        if suffix == ".h5":
            with h5py.File(path, "w") as file:
                for name, row in rows.items():
                    file[f"{name}/global_descriptor"] = row
                    file[f"{name}/image_size"] = [640, 480]
        else:
            np.save(path, np.stack(list(rows.values())))
            write_lines(path.with_suffix(".txt"), rows)
        return path

    def expected(self, exclude_same_name=False):
        names = sorted(self.images)
        images = np.stack([self.images[name] for name in names]).astype(np.float64)
        images /= np.linalg.norm(images, axis=1, keepdims=True)
        result = {}
        for query, row in self.queries.items():
            similarities = np.round(images @ row.astype(np.float64), 12)
            order = np.argsort(-similarities, kind="stable")
            result[query] = [names[i] for i in order if not (exclude_same_name and names[i] == query)][:NUM_RETRIEVED]
        return result

    def run(self, *options, output="pairs.txt"):
        path = self.folder / output
        arguments = ["--descriptors_path", self.query_path, "--database_descriptors_path", self.image_path]
        words = [*arguments, "--output_path", path, "--num_retrieved", NUM_RETRIEVED, *options]
        return retrieval.main(list(map(str, words))), path


def by_query(path):
    found = {}
    for query, image in read_pairs(path):
        found.setdefault(query, []).append(image)
    return found


@pytest.fixture(params=[".h5", ".npy"])
def files(request, tmp_path):
    return Files(tmp_path, request.param)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("suffix", [".h5", ".npy"])
def test_pairs_equal_brute_force(tmp_path, suffix, dtype, capsys):
    files = Files(tmp_path, suffix, dtype=dtype)
    code, path = files.run()
    assert code == 0 and by_query(path) == files.expected()
    assert by_query(path)["q/3.jpg"][:2] == ["db/10.jpg", "db/9.jpg"]
    output = capsys.readouterr().err
    assert "60 queries x 300 database images, 16 dimensions; blocks of 60 x 300" in output and "GB of memory" in output


def test_blocks_do_not_change_the_pairs(files, monkeypatch):
    _, whole = files.run()
    monkeypatch.setattr(plan, "MAX_NUM_IMAGES", 37)
    monkeypatch.setattr(plan, "MIN_NUM_IMAGES", 1)
    monkeypatch.setattr(exact, "NUM_QUERIES_AT_ONCE", 11)
    _, blocks = files.run("--num_threads", 1, output="blocks.txt")
    assert blocks.read_bytes() == whole.read_bytes()


def test_many_equal_images_are_compared_completely(tmp_path, capsys):
    files = Files(tmp_path, ".npy")
    for i in range(100):
        files.images[f"db/{i}.jpg"] = files.queries["q/3.jpg"]
    files.write("images", ".npy", files.images)
    _, path = files.run()
    assert by_query(path) == files.expected()
    assert "0 block(s) of single queries" not in capsys.readouterr().err


def test_shards_make_the_whole(files):
    _, path = files.run()
    shards = [files.run("--shard", f"{i}/7", output=f"{i}.txt")[1] for i in range(1, 8)]
    lines = [shard.read_text().splitlines() for shard in shards]
    assert sorted(line for part in lines for line in part) == sorted(path.read_text().splitlines())
    for i in range(7):
        assert all(Shard(i + 1, 7).holds(line.split()[0]) for line in lines[i])
    assert sum(len(part) > 0 for part in lines) >= 6


def test_empty_shard_writes_an_empty_file(files):
    query = next(iter(files.queries))
    queries = write_lines(files.folder / "one.txt", [query])
    other = next(i for i in range(1, 10) if not Shard(i, 9).holds(query))
    code, path = files.run("--shard", f"{other}/9", "--query_list_path", queries)
    assert code == 0 and path.read_bytes() == b""


def test_queries_are_ordered_by_their_first_image(files):
    lines = [f"{name} PINHOLE 640 480 500 500 320 240" for name in files.queries]
    queries = write_lines(files.folder / "list.txt", lines)
    ordered = files.folder / "ordered.txt"
    _, path = files.run("--query_list_path", queries, "--ordered_query_list_path", ordered)
    firsts = [images[0] for images in by_query(path).values()]
    assert firsts == sorted(firsts)
    assert [line.split()[0] for line in ordered.read_text().splitlines()] == list(by_query(path))
    assert sorted(ordered.read_text().splitlines()) == sorted(lines)


def test_model_names_the_database_images(files):
    some = [name for i, name in enumerate(files.images) if i % 3 == 0]
    scene = synthetic.make_scene(synthetic.arc(len(some)), [], num_points=20)
    for image, name in zip(scene.images.values(), some, strict=True):
        image.name = name
    files.images = {name: files.images[name] for name in some}
    _, path = files.run("--input_path", synthetic.write_model(files.folder / "model", scene))
    assert by_query(path) == files.expected()


def test_image_is_not_its_own_neighbour(files):
    files.queries = files.images
    files.query_path = files.image_path
    _, path = files.run("--leave_one_out")
    assert by_query(path) == files.expected(exclude_same_name=True)


def test_listed_queries_are_no_database_images(files):
    listed = list(files.images)[:4]
    files.queries = {name: files.images.pop(name) for name in listed}
    files.query_path = files.image_path
    _, path = files.run("--query_list_path", write_lines(files.folder / "list.txt", listed))
    assert by_query(path) == files.expected()


def test_memory_is_bounded(tmp_path, capsys):
    files = Files(tmp_path, ".npy")
    assert files.run("--memory_gb", "0.01")[0] == 1
    error = capsys.readouterr().err
    assert re.search(r"option --memory_gb is too little: at least \d\.\d\d GB are needed\n$", error)
    assert error.count("\n") == 1
    rows = descriptors.describe_set(descriptors.open_file(files.image_path), list(files.images))
    rows.names = rows.names * 1000  # only their number matters
    rows.dimension = 4096
    planned = plan.make_plan(rows, rows, 20, 4 * 10**9)
    assert planned.max_bytes <= 4 * 10**9
    assert planned.num_passes > 1 and planned.num_passes * planned.num_queries >= len(rows.names)


def damaged(files, change):
    """Changes one descriptor of the HDF5 file."""
    with h5py.File(files.image_path, "a") as file:
        del file["db/7.jpg/global_descriptor"]
        if change is not None:
            file["db/7.jpg/global_descriptor"] = change
    return files.image_path


BAD_ROWS = {
    "has no dataset global_descriptor of image db/7.jpg": None,
    "has 17 elements, others have 16": np.ones(17, np.float32),
    "has the shape (4, 4)": np.ones((4, 4), np.float32),
    "holds values that are not finite": np.full(DIMENSION, np.nan, np.float32),
    "is zero": np.zeros(DIMENSION, np.float32),
    "is int64": np.ones(DIMENSION, np.int64),
}


@pytest.mark.parametrize("problem", BAD_ROWS)
def test_bad_descriptor_is_named(tmp_path, problem, capsys):
    files = Files(tmp_path, ".h5")
    names = write_lines(tmp_path / "names.txt", files.images)
    path = damaged(files, BAD_ROWS[problem])
    code, output = files.run("--database_list_path", names)
    *before, error = capsys.readouterr().err.splitlines()
    assert code == 1 and not output.exists()
    assert len(before) <= 1 and all("60 queries x" in line for line in before), "the search may have begun"
    assert str(path) in error and "db/7.jpg" in error and problem in error


def bad_list(path):
    write_lines(path.with_suffix(".txt"), ["a", "b", "a"])


def short_list(path):
    write_lines(path.with_suffix(".txt"), ["a", "b"])


def truncated(path):
    path.write_bytes(path.read_bytes()[:-1000])


def foreign(path):
    path.write_bytes(b"SQLite format 3\0" * 100)


def empty(path):
    path.write_bytes(b"")


def no_groups(path):
    h5py.File(path, "w").close()


def pickled(path):
    np.save(path, np.array([{}] * 300, dtype=object), allow_pickle=True)


BAD_FILES = [
    (".npy", bad_list, "images.txt:3: image 'a' is listed twice"),
    (".npy", short_list, "images.txt: lists 2 images, but"),
    (".npy", truncated, "images.npy: is not a .npy file, or is truncated"),
    (".npy", foreign, "images.npy: is not a .npy file"),
    (".npy", empty, "images.npy: is not a .npy file"),
    (".npy", pickled, "images.npy: is not a .npy file"),
    (".npy", pathlib.Path.unlink, "images.npy: cannot be read: No such file"),
    (".h5", truncated, "images.h5: is not an HDF5 file, or is damaged"),
    (".h5", foreign, "images.h5: is not an HDF5 file"),
    (".h5", empty, "images.h5: is not an HDF5 file"),
    (".h5", no_groups, "images.h5: has no descriptors"),
    (".h5", pathlib.Path.unlink, "images.h5: cannot be read: no such file"),
]


@pytest.mark.parametrize("suffix, damage, problem", BAD_FILES)
def test_bad_file_is_named(tmp_path, suffix, damage, problem, capsys):
    files = Files(tmp_path, suffix)
    damage(files.image_path)
    code, output = files.run()
    error = capsys.readouterr().err
    assert code == 1 and error.count("\n") == 1 and problem in error
    assert [path.name for path in tmp_path.iterdir() if "pairs" in path.name] == [] and not output.exists()


def test_names_with_blanks_are_refused(tmp_path, capsys):
    files = Files(tmp_path, ".h5")
    files.images["db/a b.jpg"] = files.images["db/1.jpg"]
    files.write("images", ".h5", files.images)
    assert files.run()[0] == 1
    assert "image name 'db/a b.jpg' contains a blank" in capsys.readouterr().err


def test_dimensions_must_agree(tmp_path, capsys):
    files = Files(tmp_path, ".h5")
    files.write("queries", ".h5", {"q/1.jpg": np.ones(5, np.float32)})
    assert files.run()[0] == 1
    assert "descriptors have 5 elements, but those of the database images" in capsys.readouterr().err


def test_rounding_bound_holds():
    rng = np.random.default_rng(0)
    rows = [(x / np.linalg.norm(x, axis=1, keepdims=True)) for x in rng.normal(size=(2, 500, 4096))]
    found, _ = faiss.knn(*(x.astype(np.float32) for x in rows), 1, faiss.METRIC_INNER_PRODUCT)
    best = np.max(rows[0] @ rows[1].T, axis=1)
    assert np.max(np.abs(found[:, 0] - best)) < exact.max_rounding_error(4096)
