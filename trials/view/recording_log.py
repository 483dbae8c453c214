"""Frames of a recording in Rerun: images, labels, true poses, scene and sensors."""

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from trials.view import rerun_sdk as rr
from trials.view.meshes import Mesh
from trials.view.scene_model import SceneModel
from trials.view.stream import Stream
from trials.view.viewed_recording import MM_PER_M, ViewedRecording
from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.contract.trajectory import NS_PER_S
from vo.recordings.readers import read_imu

WORLD, CARRIER = "world", "world/carrier"
LEFT, RIGHT, DEPTH = f"{CARRIER}/left", f"{CARRIER}/right", f"{CARRIER}/left/depth"
SCENE, TRUTH = f"{WORLD}/scene", f"{WORLD}/truth"
GYRO, ACCEL, WHEELS = "sensors/gyro_radps", "sensors/accel_mps2", "sensors/wheel_ticks"
TRUE_COLOUR, WHOLE_COLOUR = (235, 238, 242), (235, 238, 242, 60)
JPEG_QUALITY = 80
CENTRE_PX = 0.5
"""Rerun counts pixels from the corner of the first one, this project from its centre."""
IMAGE_BASELINES = 3.0
"""Distance of the drawn image from a camera, in baselines."""
PATH_POINTS, THIN_POINTS = 3.0, 1.2
"""Widths of lines on the screen."""


class RecordingLog:
    """Logs the frames of a recording in order."""

    def __init__(
        self, stream: Stream, rig: StereoRig, up: Array, path: Array, scene: SceneModel | None
    ) -> None:
        """Log what has no time.

        Args:
            stream: Where to.
            rig: Calibration of the pair.
            up: (3,) axis of the world that points up.
            path: (N, 3) all true positions, metres; NaN where unknown.
            scene: Triangles of the world, if there are some.
        """
        self._stream, self._rig, self._scene = stream, rig, scene
        self._last: Array | None = None
        stream.log(WORLD, view_coordinates(up), static=True)
        log_cameras(stream, CARRIER, rig, rig.T_body_cam, TRUE_COLOUR)
        known = path[~np.isnan(path[:, 0])]
        if len(known) > 1:
            whole = rr.LineStrips3D([known], colors=[WHOLE_COLOUR], radii=points(THIN_POINTS))
            stream.log(f"{TRUTH}/whole", whole, static=True)
        if scene is not None:
            log_meshes(stream, SCENE, scene.static)
            log_meshes(stream, f"{CARRIER}/model", scene.carrier)
            for name, (meshes, _) in scene.movers.items():
                log_meshes(stream, f"{SCENE}/movers/{name}", meshes)

    def add(
        self,
        number: int,
        time_ns: int,
        T_world_cam: Array | None,
        position: Array | None = None,
        images: StereoFrame | None = None,
        depth_mm: Array | None = None,
    ) -> None:
        """Log a frame, as far as it is known.

        Args:
            number: Of the frame in the recording.
            time_ns: Its time.
            T_world_cam: (4, 4) where the cameras are shown.
            position: (3,) true position, metres; NaN where unknown.
            images: Both images.
            depth_mm: (H, W) uint16 depth of the left image; 0 where unknown.
        """
        stream = self._stream
        stream.at(number, time_ns)
        if T_world_cam is not None:
            stream.log(CARRIER, transform(T_world_cam @ se3.inverse(self._rig.T_body_cam)))
        self._last = log_step(stream, f"{TRUTH}/path", self._last, position, TRUE_COLOUR)
        if images is not None:
            stream.log(f"{LEFT}/image", encoded(images.left))
            stream.log(f"{RIGHT}/image", encoded(images.right))
        if depth_mm is not None:
            png = cv2.imencode(".png", depth_mm, [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes()
            depth = rr.EncodedDepthImage(blob=png, media_type="image/png", meter=MM_PER_M)
            stream.log(DEPTH, depth)
        if self._scene is not None:
            for name, (_, motion) in self._scene.movers.items():
                stream.log(f"{SCENE}/movers/{name}", transform(motion(time_ns / NS_PER_S)))


Readings = tuple[Indices, Array, Sequence[str]]
"""Times (M,) in ns, values (M, K), and K names."""


def sensor_readings(recording: ViewedRecording) -> dict[str, Readings]:
    """Return readings of inertial unit and wheels from the first to the last frame, by entity."""
    times_ns, wheels = recording.sequence.timestamps_ns, recording.sequence.wheels
    found: dict[str, Readings] = {}
    if (imu := read_imu(recording.folder)) is not None:
        found[GYRO] = imu.timestamps_ns, imu.gyro_radps, "xyz"
        found[ACCEL] = imu.timestamps_ns, imu.accel_mps2, "xyz"
    if wheels is not None:
        found[WHEELS] = wheels.timestamps_ns, wheels.ticks.astype(float), ("left", "right")
    for path, (at_ns, values, names) in list(found.items()):
        rows = slice(*np.searchsorted(at_ns, [times_ns[0], times_ns[-1] + 1]).tolist())
        found[path] = at_ns[rows], values[rows], names
    return {path: of for path, of in found.items() if len(of[0])}


def log_sensors(
    stream: Stream, readings: Mapping[str, Readings], recording: ViewedRecording
) -> None:
    """Log readings of sensors, each at its time and with the number of the last frame before."""
    for path, (at_ns, values, names) in readings.items():
        place = np.searchsorted(recording.sequence.timestamps_ns, at_ns, side="right") - 1
        stream.log(path, rr.SeriesLines(names=list(names)), static=True)
        stream.log_columns(path, recording.numbers[place], at_ns, values)


def log_cameras(
    stream: Stream, path: str, rig: StereoRig, T_parent_cam: Array, colour: Sequence[int]
) -> None:
    """Log the pinholes of a pair below an entity, in which the left camera is at a pose (4, 4)."""
    K = rig.K + np.array([[0, 0, CENTRE_PX], [0, 0, CENTRE_PX], [0, 0, 0]])
    T_left_right = se3.pose(np.eye(3), np.array([rig.baseline_m, 0.0, 0.0]))
    poses = {"left": T_parent_cam, "right": T_parent_cam @ T_left_right}
    for side, T_parent_side in poses.items():
        pinhole = rr.Pinhole(
            image_from_camera=K,
            resolution=(rig.width_px, rig.height_px),
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=IMAGE_BASELINES * rig.baseline_m,
            color=list(colour),
        )
        stream.log(f"{path}/{side}", transform(T_parent_side), pinhole, static=True)


def log_step(
    stream: Stream, path: str, last: Array | None, position: Array | None, colour: Sequence[int]
) -> Array | None:
    """Log a piece of a path from one position (3,) to the next; returns the latter, None if NaN.

    A view that shows all times until now shows the path so far.
    """
    if position is None or np.isnan(position).any():
        return None
    ends = [position if last is None else last, position]
    strip = rr.LineStrips3D([np.array(ends)], colors=[list(colour)], radii=points(PATH_POINTS))
    stream.log(path, strip)
    return position


def log_meshes(stream: Stream, path: str, meshes: Sequence[Mesh]) -> None:
    """Log meshes as children of an entity."""
    for k, mesh in enumerate(meshes):
        shape = rr.Mesh3D(
            vertex_positions=mesh.corners.reshape(-1, 3).astype(np.float32),
            vertex_colors=np.repeat(mesh.colours, 3, axis=0),
            vertex_texcoords=None if mesh.texcoords is None else mesh.texcoords.reshape(-1, 2),
            albedo_texture=mesh.texture,
        )
        stream.log(f"{path}/{k}", shape, static=True)


def transform(T_parent_frame: Array) -> Any:
    """Return a pose (4, 4) as a transform of Rerun."""
    return rr.Transform3D(translation=T_parent_frame[:3, 3], mat3x3=T_parent_frame[:3, :3])


def points(width: float) -> float:
    """Return a radius that is a width on the screen, in points: Rerun's negative ones."""
    return -width / 2


def encoded(image: Image) -> Any:
    """Compress an image (H, W) as JPEG."""
    jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
    return rr.EncodedImage(contents=jpeg, media_type="image/jpeg")


def view_coordinates(up: Array) -> Any:
    """Return the axes of a world whose axis `up` (3,), of length 1, points up."""
    axis = int(np.argmax(np.abs(up)))
    word = "UP" if up[axis] > 0 else "DOWN"
    return getattr(rr.ViewCoordinates, f"RIGHT_HAND_{'XYZ'[axis]}_{word}")
