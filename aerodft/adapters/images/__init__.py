"""Images: video files, stills, live streams, and stamps alone."""

from aerodft.adapters.images.camera_mode import check_mode, common_mode, refuse_other_size
from aerodft.adapters.images.gathering import Gathered, gather, image_files
from aerodft.adapters.images.jpeg import decode_jpeg, encode_jpeg
from aerodft.adapters.images.pixels import STILLS, FramePixels, PacketDecoder, StillPixels, read_camera_image
from aerodft.adapters.images.rate import LiveRate, RateSource
from aerodft.adapters.images.stills import StillsFolderSource
from aerodft.adapters.images.stream import StreamReader
from aerodft.adapters.images.video import VideoFileSource, video_info
