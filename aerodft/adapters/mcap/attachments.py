"""An attachment's record: what it says of itself, without its data, which may be of any size."""

from io import BytesIO
from typing import Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.records import Attachment

HEAD_BYTES: Final = 1 << 16
"""All but the data is shorter."""
CRC_BYTES: Final = 4
MOST_ATTACHMENTS: Final = 10_000
"""Of a file: they are held by what they say of themselves."""


class AttachmentHead(NamedTuple):
    """What a record says.

    Attributes:
        about: Name and times, without the data.
        data_at: Where the data begins in the record's content.
        data_bytes: Of it.
    """

    about: Attachment
    data_at: int
    data_bytes: int


def attachment_head(data: bytes, length: int) -> AttachmentHead:
    """The head of an attachment record.

    Args:
        data: The content's beginning, ``HEAD_BYTES`` of it where it has so many.
        length: Of the whole content.

    Raises:
        ValueError: It is damaged; others as the library has them.
    """
    stream = ReadDataStream(BytesIO(data))
    log_ns, create_ns = stream.read8(), stream.read8()
    name, kind = stream.read_prefixed_string(), stream.read_prefixed_string()
    data_bytes = stream.read8()
    if stream.count + data_bytes + CRC_BYTES != length:
        raise ValueError("claims another size than it has")
    about = Attachment(create_time=create_ns, log_time=log_ns, name=name, media_type=kind, data=b"")
    return AttachmentHead(about, stream.count, data_bytes)
