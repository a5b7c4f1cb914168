"""What a page looks at: one image, or those of a recording; measured in, searched for banks, calibrated."""

from aerodft.app.viewing.fixed import FixedCameraView
from aerodft.app.viewing.live import LiveView
from aerodft.app.viewing.questions import evidence_of, kinds_document, landmarks_in, probe_of
from aerodft.app.viewing.recording import RecordingView
from aerodft.app.viewing.view import PHOTOGRAPH, Document, View, ViewedImage
