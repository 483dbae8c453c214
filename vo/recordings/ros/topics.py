"""Choice of the topics of a bag: by the name of the recording, else by their types and names."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vo.contract.errors import DatasetError, SettingsError
from vo.contract.remarks import remark
from vo.recordings.ros.bag import Bag, bag_file, open_bag

IMAGE, COMPRESSED = "sensor_msgs/Image", "sensor_msgs/CompressedImage"
INFO, IMU, TF = "sensor_msgs/CameraInfo", "sensor_msgs/Imu", "tf2_msgs/TFMessage"
JOINTS, USUAL_JOINTS = "sensor_msgs/JointState", "/joint_states"
POSES = (
    "nav_msgs/Odometry",
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/TransformStamped",
    "geometry_msgs/PointStamped",
)
ROLES = {
    "left": (IMAGE, COMPRESSED),
    "right": (IMAGE, COMPRESSED),
    "left_info": (INFO,),
    "right_info": (INFO,),
    "imu": (IMU,),
    "wheels": (JOINTS,),
    "truth": (*POSES, TF),
}
"""What a topic is read for, and the types of its messages."""

CHOICE = re.compile(r"@(\w+=[^,=]+(?:,\w+=[^,=]+)*)$")
"""End of the name of a recording that chooses topics, as in `run.bag@left=/a,right=/b`."""

EYES = (
    *(("left", "right"), ("cam0", "cam1"), ("cam_0", "cam_1"), ("camera0", "camera1")),
    *(("camera_0", "camera_1"), ("image_0", "image_1"), ("image_00", "image_01"), ("00", "01")),
    *(("infra1", "infra2"), ("fisheye1", "fisheye2"), ("cam1", "cam2"), ("camera1", "camera2")),
    *(("camera_1", "camera_2"), ("image_02", "image_03"), ("02", "03"), ("l", "r")),
)
"""Names of the two eyes in topics; the first that fit are taken."""

NO_PICTURE = re.compile(r"depth|dispar|mask|label|segm|confidence|debug|theora|overlay|feature")
"""Images that are none of a camera, or of a video stream."""

RECTIFIED = re.compile(r"[/_]rect")
TRUE = re.compile(r"truth|(^|[/_])gt([/_]|$)|true|vicon|vrpn|mocap|optitrack|qualisys|leica")
PART = re.compile(r"gyro|accel|mag")
"""Inertial topics with a part of the readings."""


@dataclass(frozen=True)
class Source:
    """A bag with the topics that its name chooses, and those that were found."""

    bag: Bag
    chosen: Mapping[str, str]
    left: str
    right: str

    @property
    def is_rectified(self) -> bool:
        """Whether the images are rectified, by the name of their topic."""
        return RECTIFIED.search(self.left) is not None

    def info(self, eye: str) -> str | None:
        """Return the topic of the calibration of an eye, `left` or `right`; None without one."""
        if chosen := self.chosen.get(f"{eye}_info"):
            return chosen
        place = self.left if eye == "left" else self.right
        while "/" in place:
            place = place.rpartition("/")[0]
            for topic in (f"{place}/camera_info", f"{place}/info"):
                if self.bag.types.get(topic) == INFO:
                    return topic
        return None

    @property
    def imu(self) -> str | None:
        """Topic of inertial readings."""
        return self._one_of("imu", [x for x in self._of(IMU) if not PART.search(x.lower())])

    @property
    def wheels(self) -> str | None:
        """Topic of the angles of joints, among them those of wheels."""
        topics = self._of(JOINTS)
        return self._one_of("wheels", [USUAL_JOINTS] if USUAL_JOINTS in topics else topics)

    @property
    def truth(self) -> str | None:
        """Topic of the true poses: one that is named so."""
        return self._one_of("truth", [x for x in self.poses if TRUE.search(x.lower())])

    @property
    def poses(self) -> list[str]:
        """Topics of poses, those with attitude first."""
        return [x for kind in POSES for x in self._of(kind)]

    def _of(self, kind: str) -> list[str]:
        return sorted(x for x, known in self.bag.types.items() if known == kind)

    def _one_of(self, role: str, topics: list[str]) -> str | None:
        if role in self.chosen:
            return self.chosen[role]
        if len(topics) > 1:
            others = f"others are {', '.join(topics[1:])}"
            remark(f"{self.bag.path}: {role} is {topics[0]}; {others} (choose with @{role}=TOPIC)")
        return topics[0] if topics else None


def split_choice(path: Path) -> tuple[Path, dict[str, str]]:
    """Return the path of a recording without its choice of topics, and the choice by role.

    Raises:
        SettingsError: If a role is unknown.
    """
    found = CHOICE.search(str(path))
    if found is None or path.exists():
        return path, {}
    chosen = dict(x.split("=") for x in found[1].split(","))
    for role in chosen:
        if role not in ROLES:
            raise SettingsError(f"{path}: {role}: expected {', '.join(ROLES)}")
    return Path(str(path)[: found.start()]), chosen


def is_bag(path: Path) -> bool:
    """Whether a path, without its choice of topics, is a bag of ROS 1 or 2."""
    return bag_file(split_choice(path)[0]) is not None


def open_source(path: Path) -> Source:
    """Open a bag and choose its topics.

    Raises:
        DatasetError: If it cannot be read, has not the topics that its name chooses, or no stereo
            pair; lists those there are.
    """
    place, chosen = split_choice(path)
    file = bag_file(place)
    if file is None:
        raise DatasetError(f"{place}: no bag; expected a .bag, .mcap or .db3 file, or a folder")
    bag = open_bag(place, file)
    for role, topic in chosen.items():
        if bag.types.get(topic) not in ROLES[role]:
            valid = " or ".join(ROLES[role])
            what = f"is of {bag.types[topic]}" if topic in bag.types else "is not there"
            raise DatasetError(f"{place}: topic {topic} {what}; {role} is of {valid}{_listed(bag)}")
    return Source(bag, chosen, *_eyes(bag, chosen))


def _eyes(bag: Bag, chosen: Mapping[str, str]) -> tuple[str, str]:
    """Return the topics of the left and the right images."""
    if "left" in chosen and "right" in chosen:
        return chosen["left"], chosen["right"]
    images = [x for x, kind in bag.types.items() if kind in (IMAGE, COMPRESSED)]
    pictures = [x for x in images if not NO_PICTURE.search(x.lower())]
    pairs = {
        (left, right): rank
        for rank, names in enumerate(EYES)
        for left in ([chosen["left"]] if "left" in chosen else pictures)
        for right in ([chosen["right"]] if "right" in chosen else images)
        if _renamed(left, *names) == right.lower()
    }
    if not pairs:
        raise DatasetError(
            f"{bag.path}: no two topics of images are named as left and right; choose with "
            f"{bag.path}@left=TOPIC,right=TOPIC{_listed(bag)}"
        )

    def merit(pair: tuple[str, str]) -> tuple[object, ...]:
        left = pair[0]
        is_colour = "color" in left or "colour" in left
        return pairs[pair], bag.types[left] != IMAGE, not RECTIFIED.search(left), is_colour, left

    first, *others = sorted(pairs, key=merit)
    rigs = dict.fromkeys(_rig(x) for x, _ in others if _rig(x) != _rig(first[0]))
    if rigs:
        remark(f"{bag.path}: left is {first[0]}; there are also pairs in {', '.join(rigs)}")
    return first


def _rig(topic: str) -> str:
    """Return the namespace of a rig: what stands before the name of the eye."""
    names = "|".join(re.escape(x) for x, _ in EYES)
    return re.split(rf"(?<![a-z0-9])(?:{names})(?![a-z0-9])", topic, maxsplit=1)[0]


def _renamed(topic: str, left: str, right: str) -> str | None:
    """Return a topic, in lower case, with the name of the other eye; None without that of one."""
    renamed, count = re.subn(rf"(?<![a-z0-9]){left}(?![a-z0-9])", right, topic.lower())
    return renamed if count else None


def _listed(bag: Bag) -> str:
    topics = ", ".join(f"{x} ({kind})" for x, kind in sorted(bag.types.items()))
    return f"; topics: {topics or 'none'}"
