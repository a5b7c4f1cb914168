"""A flight's on-board log damaged in known ways: messages lost and invented beside pymavlink, and its poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerodft.adapters.telemetry.dataflash import DataflashSource
from aerodft.adapters.wire.pose import POSE_SCHEMA, decode_pose
from aerodft.model import RawBlock, Status
from replay.recordings import Recording
from tests.commands import run_aerodft
from tests.nights import at_night
from tests.pymavlink_logs import messages_by_pymavlink
from tests.truth.recorded_station import station

UNHARMED = 2044  # messages at the beginning: formats, and a first fix, without which there is no UTC
SHARES = (0.0005, 0.01, 0.1, 0.2)


def spans(data):
    """``(n, 2)`` start and end of each message of an undamaged log."""
    sizes, at, found = {128: 89}, 0, []
    while at + 3 <= len(data) and at + sizes[data[at + 2]] <= len(data):
        size = sizes[data[at + 2]]
        if data[at + 2] == 128:
            sizes[data[at + 3]] = data[at + 4]
        found.append((at, at + size))
        at += size
    return np.array(found)


def damaged(data, kind, share, seed=0):
    """The log with a share of its messages damaged; the places in it of whole ones, and of those changed in place."""
    rng, messages = np.random.default_rng([seed, round(share * 1e4)]), spans(data)
    old = np.frombuffer(data[: messages[-1, 1]], dtype=np.uint8)
    new, gone = old.copy(), np.zeros(len(old), dtype=np.bool_)
    put, put_at = [], []
    for start, end in messages[UNHARMED:][rng.random(len(messages) - UNHARMED) < share].tolist():
        at, size = int(rng.integers(start, end)), int(rng.integers(1, 300))
        match kind:
            case "noise" | "zeros":
                put.append(rng.bytes(size) if kind == "noise" else bytes(size))
                put_at.append(end)
            case "cut":
                gone[start + 1 + (at - start) % (end - start - 1) : end] = True
            case "deleted":
                gone[at : at + size] = True
            case "overwritten":
                new[at : at + size] = np.frombuffer(rng.bytes(size), dtype=np.uint8)[: len(new) - at]
            case "flipped":
                new[at] ^= 1 << rng.integers(8)
            case "sectors" if at % 8 == 0:  # a sector holds about as many messages
                new[at // 512 * 512 : (at // 512 + 1) * 512] = 0
    shift = np.zeros(len(old) + 1, dtype=np.int64)
    np.add.at(shift, np.array(put_at, dtype=np.int64), [len(each) for each in put])
    place = np.arange(len(old) + 1) + np.cumsum(shift) - np.concatenate([[0], np.cumsum(gone)])
    content, kept = [], 0
    for at, each in zip(put_at, put, strict=True):
        content += [new[kept:at].tobytes(), each]
        kept = at
    content.append(new[kept:][~gone[kept:]].tobytes())
    harm = np.concatenate([[0], np.cumsum(gone | (new != old))])
    is_whole = harm[messages[:, 1]] == harm[messages[:, 0]]
    starts = place[messages[:, 0]]
    changed = starts[~is_whole & (place[messages[:, 1]] - starts == messages[:, 1] - messages[:, 0])]
    return b"".join(content), set(starts[is_whole].tolist()), set(changed.tolist())


def found_in(path, sizes):
    """Places of the messages found, and of those of them that are doubtful."""
    found, doubtful, content, base = set(), set(), path.read_bytes(), 0
    for block in DataflashSource(path).events():
        assert isinstance(block, RawBlock)
        base = content.index(block.data, max(base, 0))
        for at, length in zip(block.offset.tolist(), block.length.tolist(), strict=True):
            found.add(base + at)
            if length > sizes.get(block.data[at + 2], 0):  # damage may declare types, of which no track is made
                doubtful.add(base + at)
    return found, doubtful


SEEDS = {("overwritten", 0.1): 1, ("deleted", 0.2): 1}  # at 0 pymavlink itself ends with a ValueError
CASES = [
    (kind, share)
    for share in SHARES
    for kind in ("noise", "zeros", "deleted", "cut", "overwritten", "flipped", "sectors")
]


@pytest.mark.parametrize(("kind", "share"), at_night(*CASES))
def test_no_more_messages_are_lost_than_by_pymavlink(kind, share, data_folder, tmp_path):
    path, data = tmp_path / "damaged.bin", (data_folder / "sitl/brushless_cut.BIN").read_bytes()
    content, whole, changed = damaged(data, kind, share, SEEDS.get((kind, share), 0))
    path.write_bytes(content)
    sizes = {data[start + 2]: end - start for start, end in spans(data).tolist()}
    found, doubtful = found_in(path, sizes)
    false = found - doubtful - whole - changed
    theirs = {start for start, _ in messages_by_pymavlink(path)}
    lost, theirs_lost = len(whole - found), len(whole - theirs)
    theirs_false = len(theirs - whole - changed)
    print(
        f"\n{kind} {share}: of {len(whole)} lost {lost} (pymavlink {theirs_lost}), false {len(false)} ({theirs_false})"
    )
    assert lost <= theirs_lost
    assert len(false) <= 0.1 * theirs_false


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Imports a log; the poses by their stamps."""

    def imported(content):
        folder = tmp_path_factory.mktemp("damaged")
        (folder / "station.toml").write_text(station(rate_hz=20))
        (folder / "log.bin").write_bytes(content)
        done = run_aerodft("import", folder / "log.bin", "-c", folder / "station.toml", "-o", folder / "recording")
        assert done.code == 0, done.err
        messages = Recording(folder / "recording").messages()
        return [decode_pose(m.data) for m in messages if m.channel.schema == POSE_SCHEMA]

    return imported


@pytest.fixture(scope="module")
def undamaged(imported, data_folder):
    return imported((data_folder / "sitl/brushless_cut.BIN").read_bytes())


VISIBLE = [(kind, share) for share in SHARES for kind in ("noise", "zeros", "cut", "sectors")]


@pytest.mark.parametrize(
    ("kind", "share"), [("cut", 0.1), *at_night(("deleted", 0.01), *(case for case in VISIBLE if case != ("cut", 0.1)))]
)
def test_a_pose_from_a_damaged_log_is_right_or_says_why_not(kind, share, undamaged, imported, data_folder):
    content, _, _ = damaged((data_folder / "sitl/brushless_cut.BIN").read_bytes(), kind, share, seed=1)
    poses = imported(content)
    stamps_ns = np.array([pose.stamp_ns for pose in poses])
    answered, right = 0, [pose for pose in undamaged if pose.status is Status.OK]
    for truth in right:
        pose = poses[int(np.argmin(np.abs(stamps_ns - truth.stamp_ns)))]
        assert abs(pose.stamp_ns - truth.stamp_ns) < 1_000_000
        if pose.status is not Status.OK or set(pose.reasons) - set(truth.reasons):
            assert pose.reasons
            continue
        answered += 1
        turned = (
            Rotation.from_quat(truth.pose.wxyz, scalar_first=True).inv()
            * Rotation.from_quat(pose.pose.wxyz, scalar_first=True)
        ).as_rotvec()
        off = np.concatenate([pose.pose.position_enu_m - truth.pose.position_enu_m, turned])
        assert np.all(np.abs(off) <= 1.96 * np.sqrt(np.diag(pose.pose.cov))), (truth.stamp_ns, off)
    print(f"\n{kind} {share}: {answered} of {len(right)} poses")
    assert answered > 0.9 * len(right)
