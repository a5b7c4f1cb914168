"""Writes subtitles of every known dialect, as the drones do, for one flight."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta


@dataclass(frozen=True, slots=True)
class Moment:
    """One cue's truth."""

    number: int
    ms: int
    clock: datetime
    lat: float = -44.228930
    lon: float = 171.193573
    height: float = 40.05
    yaw: float = -35.4
    pitch: float = -60.3


def time_of(ms: int) -> str:
    return f"{ms // 3600000:02d}:{ms // 60000 % 60:02d}:{ms // 1000 % 60:02d},{ms % 1000:03d}"


def _cue(m: Moment, text: str, step_ms: int = 33) -> str:
    return f"{m.number}\n{time_of(m.ms)} --> {time_of(m.ms + step_ms)}\n{text}"


def _dot(m: Moment) -> str:
    return m.clock.strftime("%Y-%m-%d %H:%M:%S.") + f"{m.clock.microsecond // 1000:03d}"


def _comma(m: Moment) -> str:
    return (
        m.clock.strftime("%Y-%m-%d %H:%M:%S,") + f"{m.clock.microsecond // 1000:03d},{m.clock.microsecond % 1000:03d}"
    )


def _place(m: Moment, lon: str = "longitude", colon: str = ":") -> str:
    return f"[latitude{colon} {m.lat:.6f}] [{lon}{colon} {m.lon:.6f}]"


def _heights(m: Moment) -> str:
    return f"[rel_alt: {m.height:.3f} abs_alt: {m.height + 64.185:.3f}]"


def _angles(m: Moment) -> str:
    return f"[gb_yaw: {m.yaw:.1f} gb_pitch: {m.pitch:.1f} gb_roll: 0.0]"


def h20n(m: Moment) -> str:
    return _cue(
        m,
        f'<font size="28">SrtCnt : {m.number}, DiffTime : 33ms\n{_dot(m)}\n\n0\n[fnum: 1.0] [focal_len: 52.00] '
        f"[dzoom_ratio: 17871, delta:0],{_place(m)} {_heights(m)} [drone_yaw: 86.0 drone_pitch: -4.2 drone_roll: 1.0] "
        f"{_angles(m)} </font>\n\n",
    )


def h20t(m: Moment) -> str:
    return _cue(
        m,
        f'<font size="28">FrameCnt: {m.number}, DiffTime: 33ms\n{_dot(m)}\n[focal_len: 58.00] [dzoom: 1.79]\n\n'
        f"0\n{_place(m)} {_heights(m)} [drone_yaw: 86.0 drone_pitch: -4.2 drone_roll: 1.0] {_angles(m)} </font>\n\n",
    )


def m3t(m: Moment) -> str:
    return _cue(
        m,
        f'<font size="28">FrameCnt: {m.number}, DiffTime: 33ms\n{_dot(m)}\n[focal_len: 40.00] [dzoom_ratio: 1.00], '
        f"{_place(m)} {_heights(m)} {_angles(m)} </font>\n\n",
    )


def m2e(m: Moment) -> str:
    return _cue(
        m,
        f'<font size="28">FrameCnt : {m.number}, DiffTime : 33ms\n{_comma(m)}\n{_place(m, "longtitude", " :")} '
        f"[altitude: {m.height:.6f}] [Drone: Yaw:{m.yaw:.1f}, Pitch:-9.0, Roll:3.1] </font>\n\n",
    )


def mavic3(m: Moment) -> str:
    return _cue(
        m,
        f'<font size="28">FrameCnt: {m.number}, DiffTime: 20ms\n{_dot(m)}\n[iso: 110] [shutter: 1/1000.0] [fnum: 3.2] '
        f"[ev: 0] [ct: 5500] [color_md: default] [focal_len: 24.00] {_place(m)} {_heights(m)} </font>\n\n",
    )


def mini5pro(m: Moment) -> str:
    return _cue(
        m,
        f'<font size="28">FrameCnt: {m.number}, DiffTime: 40ms\n{_dot(m)}\n[iso: 100] [shutter: 1/500.0] [fnum: 1.8] '
        f"[ev: 0] [color_md: hlg] [focal_len: 24.00] {_place(m)} {_heights(m)} [ct: 5419] </font>\n\n",
    )


def neo2(m: Moment) -> str:
    return _cue(
        m,
        f'<font size="28">FrameCnt: {m.number}, DiffTime: 33ms\n{_dot(m)}\n[fnum: 2.2] {_place(m)} {_heights(m)} '
        "[vsync: 9878] [eis: normal] [shift x: 0.00, y: 0.00] [pp_vsync:9878] [pp_current:0.015, 0.000, -0.000, 1.000] "
        "[pp_limit_ratio:1.0000] </font>\n\n",
    )


def m2zoom(m: Moment) -> str:
    return _cue(
        m,
        f'<font size="36">FrameCnt : {m.number}, DiffTime : 33ms\n{_comma(m)}\n[iso : 100] [focal_len : 240] '
        f"{_place(m, 'longtitude', ' :')} [altitude: {m.height:.6f}] </font>\n\n",
    )


def xt2(m: Moment) -> str:
    clock = m.clock.strftime("%Y.%m.%d %H:%M:%S")
    return _cue(m, f"{clock}\r\nGPS({m.lat:.4f},{m.lon:.4f},0.0M) BAROMETER:{m.height:.1f}M\r\n\r\n")


def mavic_pro(m: Moment) -> str:
    clock = m.clock.strftime("%Y.%m.%d %H:%M:%S")
    return _cue(
        m,
        f"HOME({m.lon:.4f},{m.lat:.4f}) {clock}\nGPS({m.lon:.4f},{m.lat:.4f},16) BAROMETER:{m.height:.1f}\n"
        "ISO:100 Shutter:60 EV: Fnum:2.2\n\n",
    )


def p4_rtk(m: Moment) -> str:
    return _cue(
        m,
        f"F/5.6, SS 400, ISO 100, EV 0, GPS ({m.lon:.6f}, {m.lat:.6f}, 15), HOME ({m.lon:.6f}, {m.lat:.6f}, -57.98m), "
        f"D 0.00m, H {m.height:.2f}m, H.S 0.00m/s, V.S 0.00m/s, F.PRY (2.7°, -7.0°, 110.1°), "
        f"G.PRY ({m.pitch:.1f}°, 0.0°, {m.yaw:.1f}°)\n\n",
    )


DIALECTS: dict[str, Callable[[Moment], str]] = {
    each.__name__: each for each in (h20n, h20t, m3t, m2e, mavic3, mini5pro, neo2, m2zoom, xt2, mavic_pro, p4_rtk)
}
WITH_ANGLES = ("h20n", "h20t", "m3t", "p4_rtk")
WITHOUT_HEIGHT = ("m2e", "m2zoom")
START = datetime(2024, 2, 28, 0, 13, 26, 240_000, tzinfo=UTC)


def moments(count: int = 60, step_ms: int = 33, start: datetime = START) -> list[Moment]:
    """A flight north at 3 m/s that climbs at 1 m/s."""
    return [
        Moment(
            number=k + 1,
            ms=k * step_ms,
            clock=start + timedelta(milliseconds=k * step_ms),
            lat=round(-44.228930 + k * step_ms * 2.7e-8, 6),
            height=round(40.05 + k * step_ms / 1000, 2),
        )
        for k in range(count)
    ]


def srt_file(dialect: str, cues: list[Moment] | None = None) -> bytes:
    return "".join(DIALECTS[dialect](each) for each in (moments() if cues is None else cues)).encode()
