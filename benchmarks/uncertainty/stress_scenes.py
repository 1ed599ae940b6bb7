"""Makes synthetic scenes in which a pose may be wrong: repetition, wrong intrinsics, wrong database poses, chance.

Each scene has queries with known poses. The matches are raw: the program verifies them, as it does for photos.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.uncertainty import stress_worlds
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.testing import synthetic

FOCAL_PX, WIDTH, HEIGHT = 800.0, 1024, 768
# Ids of cameras. The query list gives the intrinsics of the last one, those of the others are as if from EXIF.
DATABASE_CAMERA, QUERY_CAMERA, LARGER_CAMERA, GIVEN_CAMERA = 1, 2, 3, 4
LARGER = 1.25  # size of larger images over that of the database's


@dataclasses.dataclass
class Case:
    """A scene as the program gets it, and the true poses of its queries."""

    kind: str
    scene: synthetic.Scene
    truth: dict[str, Pose]

    def query_list(self) -> str:
        """Returns a query list with the intrinsics of the cameras that are given."""
        lines = []
        for name in self.scene.query_names:
            camera_id = self.scene.images[name].camera_id
            intrinsics = self.scene.cameras[camera_id].intrinsics().text() if camera_id == GIVEN_CAMERA else ""
            lines.append(f"{name} {intrinsics}".rstrip() + "\n")
        return "".join(lines)


@dataclasses.dataclass
class Matching:
    """Chances of a matcher."""

    keep_ratio: float = 0.6  # share of the common points that are matched from the same viewpoint
    likeness: float = 1.0  # matches with a wrong copy over those with the right one, from the same viewpoint
    false_ratio: float = 0.2  # random matches over the others
    max_shift: int = 3


def observe(world, camera, pose, noise_px, rng):
    """Returns keypoints and their points, with 40 keypoints of no point."""
    keypoints, owners = synthetic.observe(camera, pose, world.points, noise_px, 0.8, rng)
    if world.normals is None:
        return keypoints, owners
    to_camera = pose.cam_in_world - world.points
    faces = np.einsum("ij,ij->i", to_camera, world.normals) > 0.2 * np.linalg.norm(to_camera, axis=1)
    keep = (owners < 0) | faces[np.maximum(owners, 0)]
    return keypoints[keep], owners[keep]


def match(world, image1, image2, matching, rng):
    """Matches a database image with a query. One shift, that under which they look most alike, has most matches."""
    shifts = range(-matching.max_shift, matching.max_shift + 1) if world.num_copies else [0]
    if world.is_cyclic:
        shifts = range(world.num_copies)
    distances = {shift: world.view_distance(image2.pose, image1.pose, shift) for shift in shifts}
    likeness = {shift: matching.likeness if shift else 1.0 for shift in shifts}
    chances = {shift: likeness[shift] * 2.0 ** -(distances[shift] ** 2) for shift in shifts}
    best = max(shifts, key=lambda shift: chances[shift] * rng.uniform(0.7, 1.3))
    keypoint1 = {int(point): i for i, point in enumerate(image1.point_of_keypoint) if point >= 0}
    matches = []
    keep, keep_unique = matching.keep_ratio * chances[best], matching.keep_ratio * chances[0]
    # A camera that stands `best` copies farther on sees the copies that are as many farther back.
    shifted = world.counterpart(np.maximum(image2.point_of_keypoint, 0), -best)
    for keypoint2, (own, like) in enumerate(zip(image2.point_of_keypoint, shifted, strict=True)):
        if own < 0:
            continue
        is_unique = own >= world.num_base * world.num_copies
        if rng.random() < (keep_unique if is_unique else keep) and int(like) in keypoint1:
            matches.append((keypoint1[int(like)], keypoint2))
    num_false = int(matching.false_ratio * len(matches)) + 3
    false = [rng.integers(len(image.keypoints), size=num_false) for image in (image1, image2)]
    joined = np.concatenate([np.array(matches, int).reshape(-1, 2), np.stack(false, axis=1)])
    _, first1 = np.unique(joined[:, 0], return_index=True)
    joined = joined[np.sort(first1)]
    _, first2 = np.unique(joined[:, 1], return_index=True)
    return joined[np.sort(first2)].astype(np.uint32)


def make_scene(world, database, queries, rng, matching=None, noise_px=0.5, camera=None):
    """Makes a scene from the poses of database images and queries."""
    matching = matching or Matching()
    camera = camera or synthetic.Camera(
        DATABASE_CAMERA, "SIMPLE_RADIAL", WIDTH, HEIGHT, [FOCAL_PX, WIDTH / 2, HEIGHT / 2, 0.0]
    )
    query_camera = dataclasses.replace(camera, camera_id=QUERY_CAMERA)
    scene = synthetic.Scene({DATABASE_CAMERA: camera, QUERY_CAMERA: query_camera}, {}, {}, [])
    for prefix, camera_id, poses in (("database", DATABASE_CAMERA, database), ("query", QUERY_CAMERA, queries)):
        for i, pose in enumerate(poses):
            name = f"{prefix}/{i:03d}.jpg"
            observed = observe(world, camera, pose, noise_px, rng)
            scene.images[name] = synthetic.Image(name, len(scene.images) + 1, camera_id, pose, *observed)
            if prefix == "query":
                scene.query_names.append(name)
    for name1 in scene.database_names:
        for name2 in scene.query_names:
            matches = match(world, scene.images[name1], scene.images[name2], matching, rng)
            if len(matches) >= 12:
                scene.pairs[name1, name2] = synthetic.Pair(matches, matches, Rotation.identity(), np.zeros(3))
    return scene


def spread_evenly(num, low, high, rng):
    """Draws one number from each of `num` equal parts of a range, so that a database has no gaps."""
    return low + (high - low) * (np.arange(num) + rng.random(num)) / num


def along_corridor(num, rng, length=24.0):
    return [
        synthetic.looking_at(
            np.array([x, rng.uniform(-0.3, 0.3), rng.uniform(-0.6, 0.6)]),
            [x + 4, rng.uniform(-0.5, 0.5), rng.uniform(-1.5, 1.5)],
        )
        for x in spread_evenly(num, 1, length - 6, rng)
    ]


def before_facade(num, rng, spread=1.0):
    return [
        synthetic.looking_at(
            np.array([x, rng.uniform(-0.3, 0.3), rng.uniform(-spread, spread) - 8]),
            [x + rng.uniform(-2, 2), rng.uniform(-0.5, 0.5), 0],
        )
        for x in spread_evenly(num, -8, 8, rng)
    ]


def around_object(num, rng):
    angles = spread_evenly(num, 0, 2 * np.pi, rng)
    centres = np.stack([4 * np.sin(angles), rng.uniform(-1.5, 1.5, num), 4 * np.cos(angles)], axis=1)
    return [synthetic.looking_at(centre, rng.uniform(-0.2, 0.2, 3)) for centre in centres]


def inside_room(num, rng):
    poses = []
    for i in range(num):
        side = 1 - 2 * (i % 2)
        centre = rng.uniform([-1, -0.5, -1.5], [1, 0.5, 1.5])
        poses.append(synthetic.looking_at(centre, [3 * side, rng.uniform(-0.5, 0.5), centre[2] + rng.uniform(-1, 1)]))
    return poses


def around_cloud(num, rng, radius=6.0, half_angle_deg=50):
    angles = np.radians(rng.uniform(-half_angle_deg, half_angle_deg, num))
    radii = radius * rng.uniform(0.8, 1.2, num)
    centres = np.stack([radii * np.sin(angles), rng.uniform(-1, 1, num), -radii * np.cos(angles)], axis=1)
    return [synthetic.looking_at(centre, rng.uniform(-0.3, 0.3, 3), rng.uniform(-8, 8)) for centre in centres]


def true_poses(scene):
    return {name: scene.images[name].pose for name in scene.query_names}


def with_query_params(scene, **changes):
    """Returns the scene with other parameters of the query camera than those that made its keypoints."""
    changed = scene.copy()
    names = ("focal", "cx", "cy", "k")
    params = dict(zip(names, changed.cameras[QUERY_CAMERA].params, strict=True))
    changed.cameras[QUERY_CAMERA].params = list({**params, **changes}.values())
    return changed


def with_half_of_the_queries_larger(scene):
    """Makes every second query an image of another size, because the database then has no camera to replace its own.

    Half of these have their intrinsics in the query list, the others in the database.
    """
    changed = scene.copy()
    camera = changed.cameras[QUERY_CAMERA]
    focal, cx, cy, k = camera.params
    params = [LARGER * focal, LARGER * cx, LARGER * cy, k]
    for camera_id in (LARGER_CAMERA, GIVEN_CAMERA):
        changed.cameras[camera_id] = synthetic.Camera(
            camera_id, camera.model, int(LARGER * camera.width), int(LARGER * camera.height), params
        )
    for i, name in enumerate(changed.query_names[1::2]):
        image = changed.images[name]
        image.camera_id = (LARGER_CAMERA, GIVEN_CAMERA)[i % 2]
        image.keypoints = LARGER * image.keypoints
    return changed


def with_moved_images(scene, move):
    """Returns the scene with each pose, the queries' too, replaced by move(pose)."""
    moved = scene.copy()
    for image in moved.images.values():
        image.pose = move(image.pose)
    return moved


def drift(rng, size, scale):
    """Returns a smooth displacement of places: three waves of random directions. size: of a displacement."""
    waves = [(rng.normal(0, 1, 3) / scale, rng.uniform(0, 2 * np.pi), rng.normal(0, size, 3)) for _ in range(3)]
    turns = rng.normal(0, size / scale, (3, 3))

    def move(pose):
        phases = [np.sin(wave @ pose.cam_in_world + phase) for wave, phase, _ in waves]
        shift = sum(p * amplitude for p, (_, _, amplitude) in zip(phases, waves, strict=True))
        turn = Rotation.from_rotvec(sum(p * axis for p, axis in zip(phases, turns, strict=True))).as_matrix()
        return Pose.from_centre(pose.rotation @ turn, pose.cam_in_world + shift)

    return move


def noise(rng, rotation_deg, position):
    def move(pose):
        turn = Rotation.from_rotvec(np.radians(rotation_deg) * rng.standard_normal(3)).as_matrix()
        return Pose.from_centre(turn @ pose.rotation, pose.cam_in_world + position * rng.standard_normal(3))

    return move


def foreign(scene, rng):
    """Returns the scene with random matches, as of photos of another place."""
    changed = scene.copy()
    for name2 in changed.query_names:
        for name1 in changed.database_names:
            image1, image2 = changed.images[name1], changed.images[name2]
            num = int(min(len(image1.keypoints), len(image2.keypoints)) * rng.uniform(0.2, 1))
            matches = np.stack([rng.permutation(len(i.keypoints))[:num] for i in (image1, image2)], axis=1)
            pair = synthetic.Pair(matches.astype(np.uint32), matches, Rotation.identity(), np.zeros(3))
            changed.pairs[name1, name2] = pair
    return changed


def make_plain(rng, num_database=9, num_points=300, num_queries=10, matching=None, noise_px=0.5, camera=None):
    world = stress_worlds.cloud(rng, num_points)
    return make_scene(
        world, around_cloud(num_database, rng), around_cloud(num_queries, rng), rng, matching, noise_px, camera
    )


def log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def repetitive(world, place, num_database, rng, likeness, keep_ratio):
    matching = Matching(keep_ratio=keep_ratio, likeness=likeness)
    scene = make_scene(world, place(num_database, rng), place(10, rng), rng, matching, rng.uniform(0.3, 1))
    return scene, scene


def make_kind(kind, rng):
    """Returns the scene as the program gets it, and one with the true poses of the queries."""
    if kind == "plain":
        scene = make_plain(rng, rng.integers(4, 16), int(log_uniform(rng, 40, 500)), noise_px=rng.uniform(0.2, 1))
        return scene, scene
    if kind == "corridor":
        world = stress_worlds.corridor(rng, num_unique=int(log_uniform(rng, 100, 900)))
        return repetitive(world, along_corridor, 20, rng, rng.uniform(0.3, 1), log_uniform(rng, 0.15, 0.8))
    if kind == "facade":
        world = stress_worlds.facade(rng, num_unique=int(log_uniform(rng, 100, 900)))
        return repetitive(world, before_facade, 14, rng, rng.uniform(0.3, 1), log_uniform(rng, 0.1, 0.8))
    if kind == "symmetric object":
        world = stress_worlds.symmetric_object(rng, int(rng.choice([2, 4])), num_unique=int(log_uniform(rng, 30, 300)))
        return repetitive(world, around_object, 20, rng, rng.uniform(0.3, 1), log_uniform(rng, 0.15, 0.8))
    if kind == "mirrored walls":
        world = stress_worlds.mirrored_room(rng, num_unique=int(log_uniform(rng, 30, 300)))
        return repetitive(world, inside_room, 16, rng, rng.uniform(0.3, 1), log_uniform(rng, 0.15, 0.8))
    if kind == "wrong focal length":
        scene = make_plain(rng)
        focal_px = FOCAL_PX * rng.choice([1.02, 1.05, 1.1, 1.2, 1.5, 0.9, 0.7])
        return with_half_of_the_queries_larger(with_query_params(scene, focal=focal_px)), scene
    if kind == "wrong distortion":
        camera = synthetic.Camera(
            DATABASE_CAMERA, "SIMPLE_RADIAL", WIDTH, HEIGHT, [FOCAL_PX, WIDTH / 2, HEIGHT / 2, -0.1]
        )
        scene = make_plain(rng, camera=camera)
        return with_query_params(scene, k=rng.choice([-0.3, -0.2, 0.0, 0.1])), scene
    if kind == "few database images":
        scene = make_plain(rng, rng.integers(1, 4), int(log_uniform(rng, 60, 400)))
        return scene, scene
    if kind == "drifting database":
        scene = make_plain(rng, 15)
        moved = with_moved_images(scene, drift(rng, log_uniform(rng, 0.005, 0.06), 6.0))
        return moved, moved
    if kind == "noisy database":
        scene = make_plain(rng, 15)
        size = log_uniform(rng, 0.002, 0.1)
        return with_moved_images(scene, noise(rng, 10 * size, 2 * size)), scene
    if kind == "foreign photos":
        scene = foreign(make_plain(rng, 4, int(log_uniform(rng, 40, 80)), 4), rng)
        return scene, scene
    if kind == "blur":
        matching = Matching(keep_ratio=rng.uniform(0.1, 0.6), false_ratio=rng.uniform(0.2, 2))
        scene = make_plain(rng, 9, 200, matching=matching, noise_px=rng.uniform(1.5, 5))
        return scene, scene
    raise ValueError(kind)


KINDS = (
    "plain",
    "corridor",
    "facade",
    "symmetric object",
    "mirrored walls",
    "wrong focal length",
    "wrong distortion",
    "few database images",
    "drifting database",
    "noisy database",
    "foreign photos",
    "blur",
)


def stress_cases(num_scenes: int, seed: int = 0, kinds=KINDS) -> Iterator[Case]:
    """Yields `num_scenes` scenes of about ten queries for each kind; the first ones are the same for any number."""
    for kind in kinds:
        for i in range(num_scenes):
            rng = np.random.default_rng([seed, KINDS.index(kind), i])
            given, true = make_kind(kind, rng)
            yield Case(kind, given, true_poses(true))
