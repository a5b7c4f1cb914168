"""The simulated autopilot and the radio between it and the receiver: true motion in, late and wrong datagrams out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.geodesy import lat_lon
from aerodft.geometry.rotation import from_rotation_vector, multiply
from aerodft.model.pose import PoseStd
from aerodft.sim.packing import Packer, State
from aerodft.sim.trajectory import Trajectory

DEFAULT_RATES_HZ = {
    "HEARTBEAT": 1.0,
    "SYSTEM_TIME": 2.0,
    "ATTITUDE": 20.0,
    "GLOBAL_POSITION_INT": 20.0,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 20.0,
}
_MILLISECOND_NS = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Biases:
    """What the telemetry says minus what is true, the same for a whole flight.

    Tilt, pan and roll are rotations about the camera's x, y and z axes; the heading is clockwise, the vehicle's.
    """

    height_m: float = 0.0
    tilt_rad: float = 0.0
    pan_rad: float = 0.0
    roll_rad: float = 0.0
    heading_rad: float = 0.0


def drawn_biases(std: PoseStd, seed: int) -> Biases:
    """One flight's biases, normally distributed with these stds."""
    height, tilt, pan, roll, heading = np.random.default_rng(seed).standard_normal(5).tolist()
    return Biases(
        height_m=height * std.height_agl_m,
        tilt_rad=tilt * std.tilt_rad,
        pan_rad=pan * std.pan_rad,
        roll_rad=roll * std.roll_rad,
        heading_rad=heading * std.heading_rad,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """How the simulated autopilot speaks, and how wrong it is.

    Attributes:
        rates_hz: Messages by name; left out or 0 is not sent.
        biases: Constant errors.
        noise: White noise of every sample: height, horizontal, tilt/pan/roll (of the gimbal), heading.
        gimbal_lag_ns: The gimbal's reports are demands that the camera reaches this much later.
        clock_offset_ns: The autopilot's UTC minus the host's.
        booted_ns: Time since boot at the flight's start.
        mavlink1: MAVLink 1 frames; then the gimbal needs MOUNT_STATUS in ``rates_hz``.
        system: MAVLink system id.
        seed: Of the noise.
    """

    rates_hz: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_RATES_HZ))
    biases: Biases = field(default_factory=Biases)
    noise: PoseStd = field(default_factory=PoseStd)
    gimbal_lag_ns: int = 0
    clock_offset_ns: int = 0
    booted_ns: int = 60 * SECOND_NS
    mavlink1: bool = False
    system: int = 1
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Radio:
    """What happens to datagrams on their way.

    Attributes:
        latency_ns: Delay of every datagram.
        jitter_ns: Standard deviation of a further delay, which is never negative.
        drop: Share that is lost.
        duplicate: Share that arrives twice.
        reorder: Share that is held back behind later ones.
        hold_ns: For how long.
        outages_ns: Intervals ``(start, end)`` since the flight's start, in which nothing is sent.
        seed: Of all chances.
    """

    latency_ns: int = 0
    jitter_ns: int = 0
    drop: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    hold_ns: int = 30 * _MILLISECOND_NS
    outages_ns: tuple[tuple[int, int], ...] = ()
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Datagram:
    """Bytes and the host UTC at which they are due."""

    due_ns: int
    data: bytes


def datagrams(trajectory: Trajectory, autopilot: Autopilot) -> list[Datagram]:
    """Everything that the autopilot sends during the flight, one frame a datagram, in order of sending.

    Messages are sampled at whole milliseconds of the time since boot and sent at once.
    """
    schedule = _schedule(trajectory, autopilot.rates_hz)
    stamps = np.array([stamp for stamp, _ in schedule], dtype=np.int64)
    states = _states(trajectory, autopilot, stamps)
    packer = Packer(mavlink1=autopilot.mavlink1, system=autopilot.system)
    return [
        Datagram(due_ns=stamp, data=packer.pack(name, state))
        for (stamp, name), state in zip(schedule, states, strict=True)
    ]


def _schedule(trajectory: Trajectory, rates_hz: Mapping[str, float]) -> list[tuple[int, str]]:
    schedule = []
    for order, (name, rate_hz) in enumerate(rates_hz.items()):
        if rate_hz <= 0:
            continue
        count = int((trajectory.end_ns - trajectory.start_ns) / SECOND_NS * rate_hz) + 1
        # Streams are a millisecond apart, so that every stream has its own instants, as on a real autopilot.
        elapsed_ms = np.floor(np.arange(count) * 1000 / rate_hz).astype(np.int64) + order
        schedule += [(trajectory.start_ns + ms * _MILLISECOND_NS, name) for ms in elapsed_ms.tolist()]
    return sorted(schedule)


def _states(trajectory: Trajectory, autopilot: Autopilot, stamps_ns: np.ndarray) -> list[State]:
    generator = np.random.default_rng([autopilot.seed, 1])
    noise, biases, count = autopilot.noise, autopilot.biases, len(stamps_ns)
    at = trajectory.sampled(stamps_ns)
    velocity = trajectory.velocity_enu_mps()
    rate = trajectory.body_rate_radps()
    row = np.clip(np.searchsorted(trajectory.stamp_ns, stamps_ns), 0, len(trajectory.stamp_ns) - 1)
    horizontal = at.position_enu_m[:, :2] + noise.horizontal_m * generator.standard_normal((count, 2))
    positions = lat_lon(trajectory.origin, horizontal)
    up = at.position_enu_m[:, 2]
    home = up + biases.height_m + noise.height_agl_m * generator.standard_normal(count)
    turn = biases.heading_rad + noise.heading_rad * generator.standard_normal(count)
    body = multiply(from_rotation_vector(turn[:, None] * np.array([0.0, 0.0, 1.0])), at.ned_wxyz_body)
    # Camera axes x, y, z are the gimbal's y, z, x.
    bias = np.array([biases.roll_rad, biases.tilt_rad, biases.pan_rad])
    wobble = np.array([noise.roll_rad, noise.tilt_rad, noise.pan_rad]) * generator.standard_normal((count, 3))
    demand = trajectory.sampled(stamps_ns + autopilot.gimbal_lag_ns).level_wxyz_gimbal
    gimbal = multiply(demand, from_rotation_vector(bias + wobble))
    elapsed = stamps_ns - trajectory.start_ns
    ground_msl_m = trajectory.origin.alt_msl_m or 0.0
    return [
        State(
            boot_ms=int((elapsed[i] + autopilot.booted_ns) // _MILLISECOND_NS),
            unix_us=int(stamps_ns[i] + autopilot.clock_offset_ns) // 1000,
            lat_lon_rad=positions[i],
            alt_msl_m=ground_msl_m + float(home[i]),
            height_home_m=float(home[i]),
            height_agl_m=float(up[i]),
            velocity_ned_mps=velocity[row[i]][[1, 0, 2]] * np.array([1.0, 1.0, -1.0]),
            ned_wxyz_body=body[i],
            rate_body_radps=rate[row[i]],
            level_wxyz_gimbal=gimbal[i],
        )
        for i in range(count)
    ]


def received(sent: list[Datagram], radio: Radio) -> list[Datagram]:
    """What comes out of the radio, in order of arrival; outages count from the first datagram."""
    if not sent:
        return []
    generator = np.random.default_rng([radio.seed, 2])
    start_ns = sent[0].due_ns
    arrived = []
    for datagram in sent:
        lost, twice, held = generator.random(3) < (radio.drop, radio.duplicate, radio.reorder)
        # Whole nanoseconds: a stamp of today as a float is 256 ns off.
        delays: list[int] = np.rint(np.abs(generator.standard_normal(2)) * radio.jitter_ns).astype(int).tolist()
        elapsed = datagram.due_ns - start_ns
        if lost or any(start <= elapsed < end for start, end in radio.outages_ns):
            continue
        due_ns = datagram.due_ns + radio.latency_ns + (radio.hold_ns if held else 0)
        copies = delays if twice else delays[:1]
        arrived += [Datagram(due_ns=due_ns + delay, data=datagram.data) for delay in copies]
    return sorted(arrived, key=lambda datagram: datagram.due_ns)


def write_tlog(path: Path, arrived: list[Datagram]) -> None:
    """A telemetry log as ground stations write it: host stamp (us, big-endian, 8 bytes), then the frame."""
    with path.open("wb") as file:
        for datagram in arrived:
            file.write((datagram.due_ns // 1000).to_bytes(8, "big") + datagram.data)
