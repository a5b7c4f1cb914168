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
        self.pose = f"{self.root}/pose"
        self.image = f"{self.root}/image"
        self.jpeg = f"{self.root}/image/jpeg"
        self.video = f"{self.root}/image/video"
        self.camera = f"{self.root}/camera"
        self.measurements = f"{self.root}/measurements"
        self.height = f"{self.root}/height"
        self.location = f"{self.root}/location"
        self.calibration = f"{self.root}/calibration"
        self.camera_motion = f"{self.root}/camera_motion"
        self.status = f"{self.root}/status"
        self.alive = f"{self.root}/alive"
        self.measure = f"{self.root}/measure"
        self.probes = f"{self.root}/probes"
        self.history = f"{self.root}/history"
        self.observations = f"{self.root}/observation/*"

    def measurement(self, probe: str) -> str:
        """Where a probe's measurements are published."""
        return f"{self.root}/measurement/{key_part(probe)}"

    def observation(self, probe: str) -> str:
        """Where a probe's observations are expected."""
        return f"{self.root}/observation/{key_part(probe)}"

    def observed_probe(self, key: str) -> str:
        """The probe's name in an observation's key, as ``observation`` writes it."""
        part = key.rsplit("/", 1)[-1]
        for char in _FORBIDDEN - {"%"}:
            part = part.replace(f"%{ord(char):02X}", char)
        return part.replace("%25", "%")
