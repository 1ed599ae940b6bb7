"""Renders the demo scene: photos of a courtyard with exactly known poses and intrinsics.

    lazyloc demo --output_path DEMO

Writes below --output_path:
  images/database/*.jpg, images/query/*.jpg   the photos
  database_model/                             COLMAP text model of the database images, without points
  queries_with_intrinsics.txt                 `name MODEL width height params...`
  ground_truth/poses.txt                      `name qw qx qy qz tx ty tz` of the queries, cam_from_world
  scene.json                                  parameters and size of the scene; written last
The scenes robot, survey and panoramas write other files: see robot.py, survey.py and panoramas.py.
The same parameters give the same files. If the folder already has the complete scene, nothing is rendered.
"""

import argparse
import pathlib
import sys
from collections.abc import Callable, Sequence

from colmap_lazyloc.errors import Parser, command


def _at_least(minimum: int) -> Callable[[str], int]:
    def integer(text: str) -> int:
        if int(text) < minimum:
            raise argparse.ArgumentTypeError(f"must be at least {minimum}")
        return int(text)

    return integer


@command(name="lazyloc demo", extra="demo")
def main(arguments: Sequence[str] | None = None) -> None:
    parser = Parser(prog="lazyloc demo", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output_path", type=pathlib.Path, required=True, help="folder to write the scene to")
    parser.add_argument(
        "--scene",
        choices=("courtyard", "robot", "survey", "panoramas"),
        default="courtyard",
        help="courtyard (default); robot: a stereo camera with SLAM and odometry; survey: drone photos with GPS; "
        "panoramas: photos of a 360° camera",
    )
    parser.add_argument("--seed", type=_at_least(0), default=0, help="seed of all random choices")
    parser.add_argument("--num_database_images", type=_at_least(1), default=40, help="default: 40")
    parser.add_argument("--num_query_images", type=_at_least(1), default=10, help="default: 10")
    options = parser.parse_args(arguments)
    # Import here, because --help needs none of the optional packages.
    if options.scene == "robot":
        from colmap_lazyloc.demo.robot import make_robot_scene

        make_robot_scene(options.output_path, options.seed)
        return
    if options.scene == "survey":
        from colmap_lazyloc.demo.survey import make_survey

        make_survey(options.output_path, options.seed)
        return
    if options.scene == "panoramas":
        from colmap_lazyloc.demo.panoramas import make_panoramas

        make_panoramas(options.output_path, options.seed)
        return
    from colmap_lazyloc.demo.scene import make_scene

    make_scene(options.output_path, options.seed, options.num_database_images, options.num_query_images)


if __name__ == "__main__":
    sys.exit(main())
