"""What methods share that need nothing but a query's verified matches: the loop over the queries."""

import time
from collections.abc import Callable

from geometry import Pose
from matches import MatchDatabase, QueryMatches
from methods import MethodOptions, Result
from scenes import Camera, Scene


def localize_by(estimate_pose: Callable[[Scene, Camera, QueryMatches, int], Pose | None], scene: Scene,
                query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    """estimate_pose takes the scene, the query's camera and matches, and the seed. The seconds are its own."""
    results = {}
    with MatchDatabase(scene.database_path) as database:
        for name in query_names:
            matches = database.query_matches(scene, name, options.num_retrieved)
            start = time.perf_counter()
            pose = estimate_pose(scene, scene.camera(name), matches, options.seed)
            seconds = time.perf_counter() - start
            results[name] = Result(pose, seconds) if pose else Result.lost(seconds)
    return results
