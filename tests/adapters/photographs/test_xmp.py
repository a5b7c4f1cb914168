"""XMP packets are read as attributes and as elements; what is hostile or damaged gives nothing."""

import pytest

from aerodft.adapters.photographs.xmp import MAX_PACKET_BYTES, parse_xmp
from tests.photo_writer import dji, packet

VALUES = {
    **dji(),
    "drone-skydio:CameraOrientationNED": {"Roll": 0.5, "Pitch": -7.5, "Yaw": 127.4},
}


@pytest.mark.parametrize("as_elements", [False, True])
def test_both_forms_say_the_same(as_elements):
    found = parse_xmp(packet(VALUES, about="DJI Meta Data", as_elements=as_elements))
    assert found["drone-dji:GimbalPitchDegree"] == "-60.00"
    assert found["drone-skydio:CameraOrientationNED/Yaw"] == "127.4"
    assert found["rdf:about"] == "DJI Meta Data"


def test_what_stands_around_the_packet_is_passed_over():
    assert parse_xmp(b"xml:XMP=" + packet(VALUES) + b"\0\0  ") == parse_xmp(packet(VALUES))


def test_another_prefix_of_a_known_namespace_is_the_usual_one():
    own = packet(dji()).replace(b"drone-dji:", b"ns1:").replace(b"xmlns:drone-dji=", b"xmlns:ns1=")
    assert parse_xmp(own)["drone-dji:GimbalPitchDegree"] == "-60.00"


def test_the_first_item_of_a_list_and_the_first_of_two_values_count():
    items = b"<Camera:Bands><rdf:Seq><rdf:li>a</rdf:li><rdf:li>b</rdf:li></rdf:Seq></Camera:Bands>"
    twice = packet({"Camera:Pitch": 1.0}, as_elements=True).replace(
        b"</rdf:Description>", items + b"<Camera:Pitch>2.0</Camera:Pitch></rdf:Description>"
    )
    found = parse_xmp(twice)
    assert found["Camera:Pitch"] == "1.0"
    assert found["Camera:Bands"] == "a"


BOMB = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;">]>'
HOSTILE = {
    "entities": BOMB + packet(VALUES).partition(b"?>")[2],
    "an external entity": b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
    + packet(VALUES).partition(b"?>")[2],
    "a document type alone": b"<!DOCTYPE x>" + packet(VALUES).partition(b"?>")[2],
    "depth": b"<a>" * 100_000 + b"</a>" * 100_000,
    "size": packet(VALUES, padding=MAX_PACKET_BYTES),
    "another encoding": packet(VALUES).decode().encode("utf-16"),
    "a cut": packet(VALUES)[:400],
    "nothing": b"",
    "no XML": b"\0\xff<>\0",
    "invalid UTF-8": packet(VALUES).replace(b"-60.00", b"-6\xff.00"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_what_is_hostile_or_damaged_gives_nothing(what):
    assert parse_xmp(HOSTILE[what]) == {}
