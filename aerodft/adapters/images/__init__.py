"""Images: video files, stills, live streams, and stamps alone."""

from aerodft.adapters.images.image_sampling import NamedImage, image_files, named_images
from aerodft.adapters.images.pixels import (
    STILLS,
    FramePixels,
    PacketDecoder,
    StillPixels,
    decode_jpeg,
    encode_jpeg,
    is_key_packet,
    read_camera_image,
)
from aerodft.adapters.images.rate import LiveRate, RateSource, ThinnedPixels, is_due
from aerodft.adapters.images.stills import (
    UNREADABLE,
    StillsFolderSource,
    camera_of_still,
    check_mode,
    common_mode,
    damaged_exif_said,
    depend_on_zone,
    facts_of_still,
    refuse_other_size,
)
from aerodft.adapters.images.stream import StreamReader
from aerodft.adapters.images.video import (
    VIDEO_SUFFIXES,
    Losses,
    SeekableVideo,
    VideoFileSource,
    VideoFilesSource,
    VideoInfo,
    video_info,
)
