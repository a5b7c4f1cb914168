"""A station's endpoint and key expressions on the bus; the recording's topics are those keys."""

DEFAULT_LISTEN = "tcp/127.0.0.1:7447"
"""The endpoint that a station listens on unless its file says another."""

_FORBIDDEN = frozenset("/*$?#%")


def key_part(name: str) -> str:
    """A name as one part of a key expression: characters with a meaning there become ``%XX``."""
    return "".join(f"%{ord(char):02X}" if char in _FORBIDDEN else char for char in name) or "%"


class Keys:
    """The keys below ``aerodft/{station}``."""

    def __init__(self, station: str) -> None:
        self.root = f"aerodft/{key_part(station)}"
        self.pose = f"{self.root}/pose"  # the pose of every image
        self.image = f"{self.root}/image"  # JPEGs, with the image's index and UTC stamp attached
        self.jpeg = f"{self.root}/image/jpeg"  # in a recording, in Foxglove: images as JPEG
        self.video = f"{self.root}/image/video"  # in a recording: an H.264 stream as it came
        self.camera = f"{self.root}/camera"  # in a recording: the camera file
        self.measurements = f"{self.root}/measurements"  # in a recording: all of an image's
        self.annotations = f"{self.root}/annotations"  # in an exported file, in Foxglove: lines over the images
        self.transform = f"{self.root}/transform"  # in an exported file, in Foxglove: the camera in station axes
        self.height = f"{self.root}/height"  # heights are of another source from now on, with the step
        self.location = f"{self.root}/location"  # in a recording: the vehicle's place
        self.calibration = f"{self.root}/calibration"  # what landmarks add to the telemetry, after each image
        self.camera_motion = f"{self.root}/camera_motion"  # whether a fixed camera looks where it looked
        self.status = f"{self.root}/status"  # the state once a second, with the vehicle's health
        self.alive = f"{self.root}/alive"  # liveliness token
        self.measure = f"{self.root}/measure"  # ask with {kind, pixels} and stamp_ns, get measurements
        self.probes = f"{self.root}/probes"  # ask: what is measured
        self.history = f"{self.root}/history"  # ask: what was measured lately
        self.observations = f"{self.root}/observation/*"  # yours to publish: pixels of an observed probe

    def measurement(self, probe: str) -> str:
        """Key that a probe's measurements are published on."""
        return f"{self.root}/measurement/{key_part(probe)}"

    def number(self, probe: str) -> str:
        """Key of a probe's values alone, in exported files and in Foxglove."""
        return f"{self.root}/number/{key_part(probe)}"

    def observation(self, probe: str) -> str:
        """Key that a probe's observations are expected on."""
        return f"{self.root}/observation/{key_part(probe)}"

    def observed_probe(self, key: str) -> str:
        """The probe's name in an observation's key, as ``observation`` writes it."""
        part = key.rsplit("/", 1)[-1]
        for char in _FORBIDDEN - {"%"}:
            part = part.replace(f"%{ord(char):02X}", char)
        return part.replace("%25", "%")
