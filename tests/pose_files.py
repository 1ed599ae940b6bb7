"""Writes one camera's pose in every format that lazyloc import reads.

The camera stands at CENTRE in a world with x east, y north, z up. It looks north along the horizon and is upright: its
right is east, its down is -z. The numbers in these files are derived by hand, from the documentation of the formats.
"""

import json
import math

import numpy as np
import PIL.Image

from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.posed_images import Photos, Source
from colmap_lazyloc.pose_formats.registry import read_posed_images

CENTRE = np.array([10.0, 20.0, 5.0])
SIZE = WIDTH, HEIGHT = 640, 480
FOCAL, K1 = 500.0, -0.05
CENTRE_PX = 310.0, 250.0
NAME = "a/photo 1.jpg"
OTHER = "a/photo 2.jpg"  # its pose is the same, but it stands 2 m further east
TIMES = 1700000100, 1700000200
TIMED = tuple(f"a/{time}.jpg" for time in TIMES)  # photos that are named by their times
ROOT = math.sqrt(0.5)
ORIGIN = 47.0, 8.0, 400.0  # latitude, longitude, height of the frames that are geographic
CAMERA = Camera("PINHOLE", WIDTH, HEIGHT, (500.0, 510.0, 310.0, 250.0))  # that of pose_writers
TEXT_CAMERA = f"OPENCV {WIDTH} {HEIGHT} {FOCAL} {FOCAL} {CENTRE_PX[0]} {CENTRE_PX[1]} {K1} 0 0 0"


def write_photos(folder):
    return write_named(folder, (NAME, OTHER, *TIMED))


def write_named(folder, names, size=SIZE):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        PIL.Image.new("L", size).save(folder / name)
    return folder


def transforms(folder):
    def frame(name, east):
        matrix = [[1, 0, 0, east], [0, 0, -1, 20], [0, 1, 0, 5], [0, 0, 0, 1]]  # right, up, backward, centre
        return {"file_path": f"./{name}", "transform_matrix": matrix}

    data = {"camera_model": "OPENCV", "fl_x": FOCAL, "fl_y": FOCAL, "cx": CENTRE_PX[0], "cy": CENTRE_PX[1], "k1": K1}
    data |= {"w": WIDTH, "h": HEIGHT, "frames": [frame(NAME, 10), frame(OTHER, 12)]}
    return write(folder, "transforms.json", json.dumps(data))


def polycam(folder):
    header = "name," + ",".join(f"t_{i}{j}" for i in range(3) for j in range(4)) + ",fx,fy,cx,cy,k1,width,height\n"
    camera = f"{FOCAL},{FOCAL},{CENTRE_PX[0]},{CENTRE_PX[1]},{K1},{WIDTH},{HEIGHT}"
    rows = [f"{name},1,0,0,{east},0,0,-1,20,0,1,0,5,{camera}\n" for name, east in ((NAME, 10), (OTHER, 12))]
    return write(folder, "polycam.csv", header + "".join(rows))


def arkit(folder):
    """The logger ios_logger: timestamp, position, quaternion w x y z of the camera's axes right, up, backward."""
    return write(
        folder, "ARposes.txt", f"{TIMES[0]}.0,10,20,5,{ROOT},{ROOT},0,0\n{TIMES[1]}.0,12,20,5,{ROOT},{ROOT},0,0\n"
    )


def arkit_matrix(folder):
    rows = [f"{time},1,0,0,{east},0,0,-1,20,0,1,0,5\n" for time, east in zip(TIMES, (10, 12))]
    return write(folder, "ARKit_camera_pose.txt", "".join(rows))


def arcore(folder):
    rows = [f"{time}000000000 {ROOT} 0 0 {ROOT} {east} 20 5\n" for time, east in zip(TIMES, (10, 12))]
    return write(folder, "ARCore_camera_pose.txt", "".join(rows))


def metashape(folder, chunk_transform="", reference="LOCAL_CS[...]", poses=None):
    poses = poses or {NAME: [1, 0, 0, 10, 0, 0, 1, 20, 0, -1, 0, 5], OTHER: [1, 0, 0, 12, 0, 0, 1, 20, 0, -1, 0, 5]}
    cameras = "".join(
        f'<camera id="{i}" sensor_id="0" label="{name.split("/")[1][:-4]}">'  # without folder and ending
        f"<transform>{' '.join(map(str, values))} 0 0 0 1</transform></camera>"
        for i, (name, values) in enumerate(poses.items())
    )
    calibration = f"<f>{FOCAL}</f><cx>{CENTRE_PX[0] - WIDTH / 2}</cx><cy>{CENTRE_PX[1] - HEIGHT / 2}</cy><k1>{K1}</k1>"
    text = f"""<?xml version="1.0" encoding="UTF-8"?><document version="2.0.0"><chunk label="1">
<sensors next_id="1"><sensor id="0" label="unknown" type="frame"><resolution width="{WIDTH}" height="{HEIGHT}"/>
<calibration type="frame" class="initial"><f>1</f></calibration>
<calibration type="frame" class="adjusted"><resolution width="{WIDTH}" height="{HEIGHT}"/>{calibration}</calibration>
</sensor></sensors><cameras>{cameras}<camera id="9" sensor_id="0" label="not aligned"/></cameras>
{chunk_transform}<reference>{reference}</reference></chunk></document>"""
    return write(folder, "cameras.xml", text)


def reality_capture(folder):
    """Pitch 90 looks along the horizon; px and py are relative to the longer side."""
    camera = f"{FOCAL * 36 / WIDTH},{(CENTRE_PX[0] - 320) / WIDTH},{(CENTRE_PX[1] - 240) / WIDTH},{K1},0,0,0,0,0"
    rows = [f"{name.split('/')[1]},{east},20,5,0,90,0,{camera}\n" for name, east in ((NAME, 10), (OTHER, 12))]
    return write(folder, "rc.csv", "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n" + "".join(rows))


def opensfm(folder):
    """cam_from_world is a turn by 90 degrees about x, t = -R C; pixels are relative to the longer side."""
    camera = {"projection_type": "brown", "width": WIDTH, "height": HEIGHT, "k1": K1, "k2": 0, "p1": 0, "p2": 0}
    camera |= {"focal_x": FOCAL / WIDTH, "focal_y": FOCAL / WIDTH}
    camera |= {"c_x": (CENTRE_PX[0] - 320) / WIDTH, "c_y": (CENTRE_PX[1] - 240) / WIDTH, "k3": 0}
    shots = {
        name: {"rotation": [math.pi / 2, 0, 0], "translation": [-east, 5, -20], "camera": "v2"}
        for name, east in ((NAME, 10), (OTHER, 12))
    }
    reference = dict(zip(("latitude", "longitude", "altitude"), ORIGIN))
    content = [{"cameras": {"v2": camera}, "shots": shots, "points": {}, "reference_lla": reference}]
    return write(folder, "reconstruction.json", json.dumps(content))


def tum(folder):
    rows = [f"{time}.0 {east} 20 5 {-ROOT} 0 0 {ROOT}\n" for time, east in zip(TIMES, (10, 12))]
    return write(folder, "trajectory.txt", "# timestamp tx ty tz qx qy qz qw\n" + "".join(rows))


def kitti(folder):
    rows = [f"1 0 0 {east} 0 0 1 20 0 -1 0 5\n" for east in (10, 12, 14, 16)]
    return write(folder, "00.txt", "".join(rows))


def csv_quaternion(folder):
    header = "name,x,y,z,qw,qx,qy,qz,width,height,fx,fy,cx,cy,k1\n"
    camera = f"{WIDTH},{HEIGHT},{FOCAL},{FOCAL},{CENTRE_PX[0]},{CENTRE_PX[1]},{K1}"
    rows = [f"{name},{east},20,5,{ROOT},{-ROOT},0,0,{camera}\n" for name, east in ((NAME, 10), (OTHER, 12))]
    return write(folder, "poses.csv", header + "".join(rows))


def csv_angles(folder):
    rows = [f"{name};{east};20;5;0;0;0\n" for name, east in ((NAME, 10), (OTHER, 12))]
    return write(folder, "angles.csv", "Filename; X ;Y;Z;Yaw [deg];Pitch [deg];Roll [deg]\n" + "".join(rows))


def write(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


# The files, with their formats, and with what they leave out: intrinsics, and an exact match of times.
FILES = {
    "transforms": (transforms, "transforms", False),
    "polycam": (polycam, "arkit", False),
    "arkit": (arkit, "arkit", True),
    "arkit_matrix": (arkit_matrix, "arkit", True),
    "arcore": (arcore, "arcore", True),
    "metashape": (metashape, "metashape", False),
    "reality_capture": (reality_capture, "realitycapture", False),
    "opensfm": (opensfm, "opensfm", False),
    "tum": (tum, "tum", True),
    "kitti": (kitti, "kitti", True),
    "csv_quaternion": (csv_quaternion, "csv", False),
    "csv_angles": (csv_angles, "csv", True),
}


def source_of(path, photos, needs_camera):
    return Source(path, Photos(photos), Camera.parse("camera", TEXT_CAMERA) if needs_camera else None)


def read(path, folder=None, camera=CAMERA, form=None, **options):
    return read_posed_images(Source(path, Photos(folder), camera, **options), form)


def assert_poses(posed, truth, tolerance=1e-8, rotation_tolerance=1e-9):
    found = {image.name.removeprefix("images/"): image for image in posed.images}
    assert set(found) == set(truth)
    for name, image in found.items():
        rotation, centre = truth[name]
        assert np.abs(image.cam_from_world.rotation.T - rotation).max() < rotation_tolerance, name
        assert np.linalg.norm(image.cam_from_world.cam_in_world - centre) < tolerance, name
