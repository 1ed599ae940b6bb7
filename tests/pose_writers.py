"""Writes known poses as each program writes them, without any code of the project.

Poses are given as world_from_cam with COLMAP's axes (x right, y down, z forward), and the centre of the camera.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT = SIZE = 640, 480
FX, FY, CX, CY = 500.0, 510.0, 310.0, 250.0
CAMERA = f"PINHOLE {WIDTH} {HEIGHT} {FX} {FY} {CX} {CY}"
OPENCV = np.eye(3)
OPENGL = np.diag([1.0, -1.0, -1.0])
LEVEL = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks north in a world with x east, y north, z up
TIME = 1234.5  # of the first photo, in seconds
STEP = 1 / 30


def make_poses(names, seed=1, shift=(0, 0, 0)):
    """Returns poses in all directions by name."""
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(len(names), random_state=seed).as_matrix()
    return {
        name: (rotation, np.array(shift) + rng.uniform(-10, 10, 3))
        for name, rotation in zip(names, rotations, strict=True)
    }


def xyzw(rotation):
    return Rotation.from_matrix(rotation).as_quat().tolist()


def wxyz(rotation):
    x, y, z, w = xyzw(rotation)
    return [w, x, y, z]


def row(*values, separator=" "):
    flat = [item for value in values for item in (value if isinstance(value, list | np.ndarray) else [value])]
    return separator.join(item if isinstance(item, str) else repr(float(item)) for item in flat) + "\n"


def matrix(rotation, vector):
    return np.concatenate([rotation, np.reshape(vector, (3, 1))], axis=1)


def save(folder, name, text):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def table(folder, name, header, rows, separator=","):
    return save(folder, name, header + "\n" + "".join(row(*values, separator=separator) for values in rows))


def by_time(poses):
    return [(TIME + STEP * index, r, c) for index, (r, c) in enumerate(poses.values())]


def colmap(folder, poses):
    save(folder, "model/cameras.txt", f"1 {CAMERA}\n")
    save(folder, "model/points3D.txt", "")
    lines = [
        f"{i} " + row(wxyz(r.T), -r.T @ c).strip() + f" 1 {n}\n\n" for i, (n, (r, c)) in enumerate(poses.items(), 1)
    ]
    return save(folder, "model/images.txt", "".join(lines)).parent


def poses_txt(folder, poses):
    return save(folder, "poses.txt", "".join(row(n, wxyz(r.T), -r.T @ c) for n, (r, c) in poses.items()))


def transforms(folder, poses):
    frames = [
        {"file_path": f"./images/{n}", "transform_matrix": [*matrix(r @ OPENGL, c).tolist(), [0, 0, 0, 1]]}
        for n, (r, c) in poses.items()
    ]
    camera = {"fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY, "w": WIDTH, "h": HEIGHT}
    return save(folder, "transforms.json", json.dumps({**camera, "frames": frames}))


def polycam(folder, poses):
    header = "name," + ",".join(f"t_{i}{j}" for i in range(3) for j in range(4)) + ",fx,fy,cx,cy,width,height"
    camera = [FX, FY, CX, CY, WIDTH, HEIGHT]
    return table(
        folder, "polycam.csv", header, [(n, matrix(r @ OPENGL, c).ravel(), camera) for n, (r, c) in poses.items()]
    )


def arkit(folder, poses):
    return save(
        folder, "ARposes.txt", "".join(row(t, c, wxyz(r @ OPENGL), separator=",") for t, r, c in by_time(poses))
    )


def arcore(folder, poses):
    rows = [f"{round(t * 1e9)} " + row(xyzw(r @ OPENGL), c) for t, r, c in by_time(poses)]
    return save(folder, "ARCore_camera_pose.txt", "".join(rows))


def stray_scanner(folder, poses):
    rows = [(t, f"{i:06d}", c, xyzw(r)) for i, (t, r, c) in enumerate(by_time(poses))]
    return table(folder, "odometry.csv", "timestamp, frame, x, y, z, qx, qy, qz, qw", rows, ", ")


def euroc(folder, poses):
    names = [*(f"p_RS_R_{axis} [m]" for axis in "xyz"), *(f"q_RS_{axis} []" for axis in "wxyz")]
    names += [f"{name}_{axis}" for name in ("v_RS_R", "b_w_RS_S", "b_a_RS_S") for axis in "xyz"]
    rows = [(f"{round(t * 1e9)}", c, wxyz(r), [0.1] * 9) for t, r, c in by_time(poses)]
    return table(folder, "data.csv", "#timestamp, " + ", ".join(names), rows)


def metashape(folder, poses, kind="frame", more=""):
    cameras = "".join(
        f'<camera id="{i}" sensor_id="0" label="{n.rpartition("/")[2][:-4]}">'
        f"<transform>{row(matrix(r, c).ravel())} 0 0 0 1</transform></camera>"
        for i, (n, (r, c)) in enumerate(poses.items())
    )
    calibration = f"<f>{FY}</f><b1>{FX - FY}</b1><cx>{CX - WIDTH / 2}</cx><cy>{CY - HEIGHT / 2}</cy>{more}"
    text = f"""<?xml version="1.0" encoding="UTF-8"?><document version="2.0.0"><chunk label="1"><sensors>
<sensor id="0" label="s" type="{kind}"><resolution width="{WIDTH}" height="{HEIGHT}"/>
<calibration type="{kind}" class="adjusted">{calibration}</calibration></sensor></sensors>
<cameras>{cameras}<camera id="99" sensor_id="0" label="not aligned"/></cameras></chunk></document>"""
    return save(folder, "cameras.xml", text)


def blocks_exchange(folder, poses, definition="", axes=OPENCV, orientation="XRightYDown"):
    def photo(name, r, c):
        rotation = axes @ r.T
        cells = "".join(f"<M_{i}{j}>{float(rotation[i, j])!r}</M_{i}{j}>" for i in range(3) for j in range(3))
        centre = "".join(f"<{axis}>{float(value)!r}</{axis}>" for axis, value in zip("xyz", c, strict=True))
        pose = f"<Pose><Rotation>{cells}</Rotation><Center>{centre}</Center></Pose>"
        return f"<Photo><ImagePath>D:\\photos\\{name}</ImagePath>{pose}</Photo>"

    srs = (
        f"<SpatialReferenceSystems><SRS><Id>0</Id><Definition>{definition}</Definition></SRS></SpatialReferenceSystems>"
    )
    camera = f"<ImageDimensions><Width>{WIDTH}</Width><Height>{HEIGHT}</Height></ImageDimensions>"
    camera += f"<FocalLength>28.125</FocalLength><SensorSize>36</SensorSize><CameraOrientation>{orientation}"
    camera += f"</CameraOrientation><PrincipalPoint><x>{CX}</x><y>{CY}</y></PrincipalPoint>"
    photos = "".join(photo(name, r, c) for name, (r, c) in poses.items())
    block = f"<Block><SRSId>0</SRSId><Photogroups><Photogroup>{camera}{photos}</Photogroup></Photogroups></Block>"
    return save(folder, "b.xml", f'<?xml version="1.0"?><BlocksExchange version="2.1">{srs}{block}</BlocksExchange>')


def reality_capture(folder, poses, scan2=False):
    names = "yaw,pitch,roll,f_35mm,px_norm,py_norm" if scan2 else "heading,pitch,roll,f,px,py"
    rows = []
    for name, (r, c) in poses.items():
        yaw, pitch, roll = Rotation.from_matrix(r @ OPENGL).as_euler("ZXY", degrees=True)
        camera = [28.125, (CX - WIDTH / 2) / WIDTH, (CY - HEIGHT / 2) / WIDTH, 0, 0, 0, 0, 0, 0]
        rows.append((name.rpartition("/")[2], c, -yaw, pitch, roll, camera))
    return table(folder, "rc.csv", f"#name,x,y,alt,{names},k1,k2,k3,k4,t1,t2", rows)


def xmp(folder, poses):
    """As RealityCapture 1 writes them."""
    px, py = (CX - WIDTH / 2) / WIDTH, (CY - HEIGHT / 2) / WIDTH
    for name, (r, c) in poses.items():
        text = f"""<x:xmpmeta xmlns:x="adobe:ns:meta/">
  <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
    <rdf:Description xcr:Version="3" xcr:PosePrior="locked" xcr:Coordinates="absolute"
       xcr:DistortionModel="brown3" xcr:FocalLength35mm="28.125" xcr:Skew="0" xcr:AspectRatio="1"
       xcr:PrincipalPointU="{px!r}" xcr:PrincipalPointV="{py!r}" xcr:CalibrationPrior="exact" xcr:CalibrationGroup="-1"
       xcr:DistortionGroup="-1" xcr:InTexturing="1" xcr:InMeshing="1"
       xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">
      <xcr:Rotation>{row(r.T.ravel())}</xcr:Rotation>
      <xcr:Position>{row(c)}</xcr:Position>
      <xcr:DistortionCoeficients>0 0 0 0 0 0</xcr:DistortionCoeficients>
    </rdf:Description>
  </rdf:RDF>
</x:xmpmeta>
"""
        save(folder / "xmp", name.rpartition("/")[2].replace(".jpg", ".xmp"), text)
    return folder / "xmp"


def pix4d(folder, poses):
    rows = [(n, c, Rotation.from_matrix(r @ OPENGL).as_euler("XYZ", degrees=True)) for n, (r, c) in poses.items()]
    path = "calibrated_external_camera_parameters.txt"
    return table(folder, path, "imageName X Y Z Omega Phi Kappa", rows, " ")


OPENSFM_CAMERA = {
    "projection_type": "brown",
    "width": WIDTH,
    "height": HEIGHT,
    "focal_x": FX / WIDTH,
    "focal_y": FY / WIDTH,
}
OPENSFM_CAMERA |= {"c_x": (CX - WIDTH / 2) / WIDTH, "c_y": (CY - HEIGHT / 2) / WIDTH, "k1": 0, "k2": 0, "k3": 0}


def opensfm(folder, poses, reference=None, name="reconstruction.json"):
    shots = {
        n: {
            "rotation": Rotation.from_matrix(r.T).as_rotvec().tolist(),
            "translation": (-r.T @ c).tolist(),
            "camera": "v2",
        }
        for n, (r, c) in poses.items()
    }
    place = {} if reference is None else dict(zip(("latitude", "longitude", "altitude"), reference, strict=True))
    content = [{"cameras": {"v2": OPENSFM_CAMERA}, "shots": shots, "points": {}}]
    if reference is not None:
        content[0]["reference_lla"] = place
    return save(folder, name, json.dumps(content))


def odm_shots(folder, poses, coordinates=(0, 0, 0)):
    save(folder, "cameras.json", json.dumps({"v2": OPENSFM_CAMERA}))
    features = []
    for name, (r, c) in poses.items():
        values = {"filename": name, "focal": FX / WIDTH, "width": WIDTH, "height": HEIGHT, "translation": c.tolist()}
        values["rotation"] = Rotation.from_matrix(r.T).as_rotvec().tolist()
        point = coordinates[name] if isinstance(coordinates, dict) else coordinates
        features.append({"properties": values, "geometry": {"type": "Point", "coordinates": list(point)}})
    return save(folder, "shots.geojson", json.dumps({"type": "FeatureCollection", "features": features}))


def bundler(folder, poses):
    save(folder, "list.txt", "".join(f"./images/{name} 0 {FX}\n" for name in poses))
    parts = [
        f"{FX} 0 0\n" + "".join(row(values) for values in (*(OPENGL @ r.T), OPENGL @ -r.T @ c))
        for r, c in poses.values()
    ]
    return save(folder, "bundle.out", f"# Bundle file v0.3\n{len(poses)} 0\n" + "".join(parts))


def nvm(folder, poses):
    rows = [f"{n}\t" + row(FX, wxyz(r.T), c, 0.0, "0") for n, (r, c) in poses.items()]
    return save(folder, "model.nvm", f"NVM_V3 FixedK {FX} {CX} {FY} {CY} 0\n\n{len(rows)}\n" + "".join(rows) + "\n0\n")


def cambridge(folder, poses):
    head = "Visual Landmark Dataset V1\nImageFile, Camera Position [X Y Z W P Q R]\n\n"
    return save(folder, "dataset_train.txt", head + "".join(row(n, c, wxyz(r.T)) for n, (r, c) in poses.items()))


def record3d(folder, poses):
    content = {"w": WIDTH, "h": HEIGHT, "fps": 60, "K": [FX, 0, 0, 0, FY, 0, CX, CY, 1]}
    content["poses"] = [[*xyzw(r @ OPENGL), *c.tolist()] for r, c in poses.values()]
    return save(folder, "metadata.json", json.dumps(content))


def polycam_keyframes(folder, poses):
    camera = {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": WIDTH, "height": HEIGHT, "timestamp": 1.0}
    for name, (r, c) in poses.items():
        values = {f"t_{i}{j}": float(value) for (i, j), value in np.ndenumerate(matrix(r @ OPENGL, c))}
        save(folder, f"corrected_cameras/{name.rpartition('/')[2][:-4]}.json", json.dumps({**values, **camera}))
    return folder / "corrected_cameras"


def splatting(folder, poses):
    content = [
        {"id": i, "img_name": n, "width": WIDTH, "height": HEIGHT, "position": c.tolist(), "rotation": r.tolist()}
        for i, (n, (r, c)) in enumerate(poses.items())
    ]
    return save(folder, "cameras.json", json.dumps([{**camera, "fx": FX, "fy": FY} for camera in content]))


def tum(folder, poses, times=None):
    head = "# ground truth trajectory\n# file: 'rgbd.bag'\n# timestamp tx ty tz qx qy qz qw\n"
    times = times or [t for t, _, _ in by_time(poses)]
    return save(
        folder, "slam.txt", head + "".join(row(t, c, xyzw(r)) for t, (r, c) in zip(times, poses.values(), strict=True))
    )


def kitti(folder, poses):
    return save(folder, "00.txt", "".join(row(matrix(r, c).ravel()) for r, c in poses.values()))


def kitti360(folder, poses):
    rows = [f"{i} " + row(matrix(r, c).ravel(), "0 0 0 1") for i, (r, c) in enumerate(poses.values())]
    return save(folder, "cam0_to_world.txt", "".join(rows))


def rtabmap(folder, poses):
    rows = [row(t, c, xyzw(r)).strip() + f" {i}\n" for i, (t, r, c) in enumerate(by_time(poses))]
    return save(folder, "rtabmap_camera_poses.txt", "#timestamp x y z qx qy qz qw id\n" + "".join(rows))


def matrices(folder, poses):
    return save(folder, "traj.txt", "".join(row(matrix(r, c).ravel(), "0 0 0 1") for r, c in poses.values()))


def matrices_of_open3d(folder, poses):
    parts = [
        f"{i} {i} {i + 1}\n" + "".join(row(values) for values in matrix(r, c)) + "0 0 0 1\n"
        for i, (r, c) in enumerate(poses.values())
    ]
    return save(folder, "trajectory.log", "".join(parts))


def matrices_of_7_scenes(folder, poses):
    for index, (r, c) in enumerate(poses.values()):
        text = "".join(row(values, separator="\t") for values in [*matrix(r, c), np.array([0, 0, 0, 1.0])])
        save(folder, f"seq-01/frame-{index:06}.pose.txt", text)
    return folder / "seq-01"


def matrix_text(rotation, vector):
    return "".join(row(values) for values in [*matrix(rotation, vector), np.array([0, 0, 0, 1.0])])


def seven_scenes(folder, poses):
    """A pose of a test sequence is not read."""
    save(folder, "scene/TrainSplit.txt", "sequence1\n")
    for index, (r, c) in enumerate(poses.values()):
        save(folder, f"scene/seq-01/frame-{index:06}.pose.txt", matrix_text(r, c))
    save(folder, "scene/seq-02/frame-000000.pose.txt", matrix_text(np.eye(3), np.zeros(3)))
    return folder / "scene"


def twelve_scenes(folder, poses):
    """The first two frames are for testing."""
    info = f"m_colorWidth = {WIDTH}\nm_colorHeight = {HEIGHT}\nm_depthWidth = 320\n"
    info += f"m_calibrationColorIntrinsic = {FX} 0 {CX} 0 0 {FY} {CY} 0 0 0 1 0 0 0 0 1\n"
    save(folder, "scene/info.txt", info)
    save(
        folder, "scene/split.txt", "sequence0 [frames=2]  [start=0 ; end=1]\nsequence1 [frames=5]  [start=2 ; end=6]\n"
    )
    for index, (r, c) in enumerate([(np.eye(3), np.zeros(3))] * 2 + list(poses.values())):
        save(folder, f"scene/data/frame-{index:06}.pose.txt", matrix_text(r, c))
    return folder / "scene"


def scannet(folder, poses):
    intrinsics = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1.0]])
    save(folder, "scene/intrinsic/intrinsic_color.txt", matrix_text(intrinsics, np.zeros(3)))
    for index, (r, c) in enumerate(poses.values()):
        save(folder, f"scene/pose/{index}.txt", matrix_text(r, c))
    return folder / "scene"


def arkit_scenes(folder, poses):
    """Each photo has intrinsics of its own; those of larger photos are not for these."""
    rows = []
    for t, r, c in by_time(poses):
        rows.append(row(round(t, 3), Rotation.from_matrix(r.T).as_rotvec(), -r.T @ c))
        save(folder, f"video/lowres_wide_intrinsics/41_{t:.3f}.pincam", row(WIDTH, HEIGHT, FX, FY, CX, CY))
    save(folder, "video/wide_intrinsics/41_1234.500.pincam", row(1920, 1440, 1600, 1600, 960, 720))
    save(folder, "video/lowres_wide.traj", "".join(rows))
    return folder / "video"


def cambridge_folder(folder, poses):
    cambridge(folder / "scene", poses)
    nvm(folder / "scene", poses).rename(folder / "scene" / "reconstruction.nvm")
    return folder / "scene"


def csv_quaternion(folder, poses):
    camera = [WIDTH, HEIGHT, FX, FY, CX, CY]
    rows = [(n, c, wxyz(r), camera) for n, (r, c) in poses.items()]
    return table(folder, "own.csv", "name,x,y,z,qw,qx,qy,qz,width,height,fx,fy,cx,cy", rows)


def csv_xyzw(folder, poses):
    return table(folder, "own.csv", "qx;qy;qz;qw;x;y;z;file", [(xyzw(r), c, n) for n, (r, c) in poses.items()], ";")


def csv_angles(folder, poses):
    angles = {
        n: Rotation.from_matrix(r @ LEVEL.T).as_euler("ZXY", degrees=True) * (-1, 1, 1) for n, (r, _) in poses.items()
    }
    rows = [(n, c, angles[n]) for n, (_, c) in poses.items()]
    return table(folder, "own.csv", "Filename\tX [m]\tY [m]\tZ [m]\tYaw [deg]\tPitch [deg]\tRoll [deg]", rows, "\t")


def csv_translation(folder, poses):
    return table(
        folder, "own.csv", "image_name,tx,ty,tz,qw,qx,qy,qz", [(n, -r.T @ c, wxyz(r.T)) for n, (r, c) in poses.items()]
    )


@dataclass(frozen=True)
class Writer:
    """A kind of file: its format, and what it leaves out: names (then photos are numbered from 0) or intrinsics.

    `photos`: their names in a dataset.
    """

    form: str
    write: Callable
    names: bool = True
    camera: str | None = CAMERA  # what is read; None if --camera is needed
    options: dict = field(default_factory=dict)
    photos: tuple[str, ...] | None = None


ONE_FOCAL_LENGTH = f"PINHOLE {WIDTH} {HEIGHT} {FX} {FX} {CX} {CY}"
CENTRED = f"PINHOLE {WIDTH} {HEIGHT} {FX} {FX} {WIDTH / 2} {HEIGHT / 2}"
WRITERS = {
    "colmap": Writer("colmap", colmap),
    "poses": Writer("poses", poses_txt, camera=None),
    "transforms": Writer("transforms", transforms),
    "polycam": Writer("arkit", polycam),
    "arkit": Writer("arkit", arkit, False, None),
    "arcore": Writer("arcore", arcore, False, None),
    "stray_scanner": Writer("strayscanner", stray_scanner, False, None),
    "euroc": Writer("euroc", euroc, False, None, {"camera_axes": "opencv"}),
    "metashape": Writer("metashape", metashape),
    "blocks_exchange": Writer("blocksexchange", blocks_exchange, camera=ONE_FOCAL_LENGTH),
    "reality_capture": Writer("realitycapture", reality_capture, camera=ONE_FOCAL_LENGTH),
    "reality_scan": Writer("realitycapture", lambda *a: reality_capture(*a, scan2=True), camera=ONE_FOCAL_LENGTH),
    "xmp": Writer("xmp", xmp, camera=ONE_FOCAL_LENGTH),
    "pix4d": Writer("pix4d", pix4d, camera=None),
    "opensfm": Writer("opensfm", opensfm),
    "odm_shots": Writer("odmshots", odm_shots),
    "bundler": Writer("bundler", bundler, camera=CENTRED),
    "nvm": Writer("nvm", nvm),
    "cambridge": Writer("cambridge", cambridge, camera=None),
    "cambridge_folder": Writer("cambridge", cambridge_folder),
    "record3d": Writer("record3d", record3d, False),
    "polycam_keyframes": Writer("polycam", polycam_keyframes),
    "splatting": Writer("splatting", splatting, camera=f"PINHOLE {WIDTH} {HEIGHT} {FX} {FY} {WIDTH / 2} {HEIGHT / 2}"),
    "tum": Writer("tum", tum, False, None),
    "kitti": Writer("kitti", kitti, False, None),
    "kitti360": Writer("kitti360", kitti360, False, None),
    "rtabmap": Writer("rtabmap", rtabmap, False, None),
    "matrices": Writer("matrices", matrices, False, None),
    "open3d": Writer("matrices", matrices_of_open3d, False, None),
    "7_scenes": Writer("matrices", matrices_of_7_scenes, False, None),
    "7_scenes_folder": Writer(
        "7scenes",
        seven_scenes,
        camera="SIMPLE_PINHOLE 640 480 525 320 240",
        photos=tuple(f"seq-01/frame-{index:06}.color.png" for index in range(5)),
    ),
    "12_scenes": Writer(
        "12scenes", twelve_scenes, photos=tuple(f"data/frame-{index:06}.color.jpg" for index in range(2, 7))
    ),
    "scannet": Writer("scannet", scannet, photos=tuple(f"color/{index}.jpg" for index in range(5))),
    "arkit_scenes": Writer(
        "arkitscenes",
        arkit_scenes,
        photos=tuple(f"lowres_wide/41_{TIME + STEP * index:.3f}.png" for index in range(5)),
    ),
    "csv_quaternion": Writer("csv", csv_quaternion),
    "csv_xyzw": Writer("csv", csv_xyzw, camera=None),
    "csv_angles": Writer("csv", csv_angles, camera=None),
    "csv_translation": Writer("csv", csv_translation, camera=None),
}
