"""Writes small ULog files, by the format's published description."""

import struct

MAGIC = b"ULog\x01\x12\x35"
CODES = {
    "int8_t": "b",
    "uint8_t": "B",
    "bool": "B",
    "int32_t": "i",
    "uint16_t": "H",
    "uint32_t": "I",
    "uint64_t": "Q",
    "float": "f",
    "double": "d",
}
ATTITUDE = "uint64_t timestamp;float[4] q;"
HOME = "uint64_t timestamp;double lat;double lon;float alt;float z;bool valid_lpos;"
LOCAL = (
    "uint64_t timestamp;float z;float delta_z;float dist_bottom;float ref_alt;bool z_valid;uint8_t z_reset_counter;"
    "bool dist_bottom_valid;uint8_t dist_bottom_sensor_bitfield;uint8_t[4] _padding0;"
)
OLD_LOCAL = "uint64_t timestamp;float z;float dist_bottom;bool dist_bottom_valid;uint8_t[3] _padding0;"
OLD_GPS = (
    "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;float eph;float epv;"
    "int32_t timestamp_time_relative;uint8_t fix_type;uint8_t satellites_used;uint8_t[2] _padding0;"
)
NEW_GPS = (
    "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;double altitude_msl_m;"
    "float eph;float epv;int32_t timestamp_time_relative;uint8_t fix_type;uint8_t satellites_used;"
)
GLOBAL = "uint64_t timestamp;double lat;double lon;float alt;"
SENSOR = (
    "uint64_t timestamp;float min_distance;float max_distance;float current_distance;float variance;"
    "int8_t signal_quality;uint8_t orientation;"
)
GIMBAL = (
    "uint64_t timestamp;float[4] q;float delta_yaw;uint32_t failure_flags;uint16_t device_flags;"
    "uint8_t gimbal_device_id;"
)
CAPTURE = "uint64_t timestamp;uint64_t timestamp_utc;uint32_t seq;double lat;double lon;float alt;int8_t result;"
TRIGGER = "uint64_t timestamp;uint64_t timestamp_utc;uint32_t seq;bool feedback;"


def message(kind: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(kind)) + payload


class UlogWriter:
    """Collects a log's messages.

    Args:
        start_us: In the file's header.
        flags: Payload of a message of flags; empty for none.
    """

    def __init__(self, start_us: int = 1_000_000, flags: bytes = b"") -> None:
        self.parts = [MAGIC + b"\x01" + struct.pack("<Q", start_us)]
        if flags:
            self.parts.append(message("B", flags))
        self._structs: dict[int, struct.Struct] = {}

    def subscribe(self, name: str, fields: str, instance: int = 0) -> int:
        """Declare a topic and subscribe to it; returns the number of its data."""
        number = len(self._structs)
        codes = ""
        for field in filter(None, fields.split(";")):
            kind, own = field.split(" ")
            kind, _, count = kind.partition("[")
            if not own.startswith("_padding"):
                codes += count.rstrip("]") + CODES[kind]
        self.parts.append(message("F", f"{name}:{fields}".encode()))
        self.parts.append(message("A", struct.pack("<BH", instance, number) + name.encode()))
        self._structs[number] = struct.Struct("<" + codes)
        return number

    def add(self, number: int, *values: float) -> None:
        self.parts.append(message("D", struct.pack("<H", number) + self._structs[number].pack(*values)))

    def other(self, kind: str, payload: bytes) -> None:
        self.parts.append(message(kind, payload))

    def file(self) -> bytes:
        return b"".join(self.parts)
